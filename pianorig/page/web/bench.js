// The frame of the page: the list of views, the view that the address names, help, who may write.
import { showAction } from "./action.js";
import { address, VIEWS } from "./address.js";
import { make } from "./elements.js";
import { helpOf } from "./help.js";
import { showLive } from "./live.js";
import { showOutlines } from "./outlines.js";
import { showReview } from "./review.js";
import { askAbout } from "./server.js";
import { showSessions } from "./sessions.js";
import { say } from "./user.js";

const SHOW = { sessions: showSessions, live: showLive, review: showReview, outlines: showOutlines, action: showAction };
const views = document.getElementById("views"), helped = document.getElementById("helped");
let main = document.getElementById("main"), turn = 0, leave = null;

/** Each view has a main element of its own: one that is left while it still reads cannot write into the next. */
async function show() {
  if (location.hash === "#main") { main.focus(); return; }
  const { view, values } = address(), mine = ++turn, place = main.cloneNode(false);
  leave?.();
  leave = null;
  views.replaceChildren(...Object.entries(VIEWS).map(([name, title]) =>
    make("li", {}, make("a", { href: `#${name}`, "aria-current": name === view ? "page" : null }, title))));
  document.title = `${VIEWS[view]} – piano action bench`;
  for (const key of Object.keys(place.dataset)) delete place.dataset[key];
  main.replaceWith(place);
  main = place;
  let done = null;
  try { done = await SHOW[view](place, values); } catch (error) { place.append(make("p", { class: "notice", role: "alert" }, error.message)); }
  if (mine === turn) leave = done; else done?.();
}

function help() { helped.replaceChildren(...helpOf(address().view), make("form", { method: "dialog" }, make("button", { class: "first" }, "Close"))); helped.showModal(); }
document.getElementById("help").addEventListener("click", help);
document.addEventListener("keydown", (event) => { if (event.key === "?" && !helped.open && !event.target.closest?.("input, textarea, select")) { event.preventDefault(); help(); } });
addEventListener("hashchange", show);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show); // what is drawn has its colours from the style
try {
  const about = await askAbout();
  document.getElementById("rights").textContent = `${about.folder} · ${about.may_write ? "may write" : "looks only"}`;
} catch (error) { say(error.message); }
show();
