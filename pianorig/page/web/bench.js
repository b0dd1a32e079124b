// The frame of the page: views, address, questions to the server. Whatever comes from a file is set as text, never as markup.
import { showAction } from "./action.js";
import { make } from "./elements.js";
import { helpOf } from "./help.js";
import { showLive } from "./live.js";
import { showOutlines } from "./outlines.js";
import { showReview } from "./review.js";
import { showSessions } from "./sessions.js";

export { make };

const VIEWS = { sessions: ["Sessions", showSessions], live: ["Live", showLive], review: ["Review", showReview], outlines: ["Outlines", showOutlines], action: ["Action", showAction] };
let main = document.getElementById("main"), turn = 0;
const views = document.getElementById("views"), said = document.getElementById("said");
let about = {}, leave = null, quiet = null;

/** What the server answers; an error is its one line. */
export async function ask(path, { method = "GET", body } = {}) {
  const options = { method, headers: body ? { "Content-Type": "application/json" } : {}, body: body && JSON.stringify(body) };
  let answer;
  try { answer = await fetch(path, options); } catch { throw new Error("the bench does not answer; is  pianorig bench  still running?"); }
  const content = await answer.json();
  if (!answer.ok) throw new Error(content.error);
  return content;
}

export function say(text) {
  said.textContent = text;
  clearTimeout(quiet);
  quiet = setTimeout(() => { said.textContent = ""; }, 9000);
}

/** The colour of a body, everywhere the same. */
export const colourOf = (name, i) => about.colours?.[name] || about.other_colours?.[i % about.other_colours.length] || "#767676";

export const mayWrite = () => about.may_write;
export const at = (name) => encodeURIComponent(name);

/** View and values of the address: #review?session=a&trial=1 */
export function address() {
  const [view, values] = location.hash.slice(1).split("?");
  return { view: view in VIEWS ? view : "sessions", values: new URLSearchParams(values || "") };
}

export const link = (view, values) => `#${view}?${new URLSearchParams(values)}`;

/** Give the user a text as a file; nothing is written by the server. */
export function download(text, name, type) {
  const url = URL.createObjectURL(new Blob([text], { type }));
  make("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

/** Keep values in the address without drawing anew, so that a reload comes back to the same place. */
export function remember(values) {
  const { view, values: old } = address();
  for (const [key, value] of Object.entries(values)) {
    if (value === null || value === undefined || value === "") old.delete(key); else old.set(key, value);
  }
  history.replaceState(null, "", link(view, old));
}

/** Each view has a main element of its own: one that is left while it still reads cannot write into the next. */
async function show() {
  if (location.hash === "#main") { main.focus(); return; }
  const { view, values } = address(), mine = ++turn, place = main.cloneNode(false);
  leave?.();
  leave = null;
  views.replaceChildren(...Object.entries(VIEWS).map(([name, [title]]) =>
    make("li", {}, make("a", { href: `#${name}`, "aria-current": name === view ? "page" : null }, title))));
  document.title = `${VIEWS[view][0]} – piano action bench`;
  for (const key of Object.keys(place.dataset)) delete place.dataset[key];
  main.replaceWith(place);
  main = place;
  let done = null;
  try { done = await VIEWS[view][1](place, values); } catch (error) { place.append(make("p", { class: "notice", role: "alert" }, error.message)); }
  if (mine === turn) leave = done; else done?.();
}

const helped = document.getElementById("helped");
function help() { helped.replaceChildren(...helpOf(address().view), make("form", { method: "dialog" }, make("button", { class: "first" }, "Close"))); helped.showModal(); }
document.getElementById("help").addEventListener("click", help);
document.addEventListener("keydown", (event) => { if (event.key === "?" && !helped.open && !event.target.closest?.("input, textarea, select")) { event.preventDefault(); help(); } });
addEventListener("hashchange", show);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show); // what is drawn has its colours from the style
try {
  about = await ask("/api/about");
  document.getElementById("rights").textContent = `${about.folder} · ${about.may_write ? "may write" : "looks only"}`;
} catch (error) { say(error.message); }
show();
