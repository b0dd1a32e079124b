// The frame of the page: the list of views, the view that the address names, help, who may write.
// elements.js and the moving action's scripts are shared with exported animations: pianorig/player/web.
import { showAction } from "./action.js";
import { address, link } from "./address.js";
import { make } from "./elements.js";
import { helpOf } from "./help.js";
import { showLive } from "./live.js";
import { showOutlines } from "./outlines.js";
import { showReview } from "./review.js";
import { askAbout } from "./server.js";
import { showSessions } from "./sessions.js";
import { say } from "./user.js";

const TIME = [["Space", "plays and pauses"], ["\u2190 \u2192", "one frame, or 1 ms; with Shift ten"], ["n, p", "to the next and previous event"], ["Home, End", "to the ends"]];
/** The views by their name in the address, in the order of the list at the top: title, what shows them, help. */
const VIEWS = {
  sessions: { title: "Sessions", show: showSessions, keys: [["Enter", "on a column's head sorts by it"]],
    words: "Every folder with a session.toml. A name opens it: trials, report, annotations. What is written is only ever added." },
  live: { title: "Live", show: showLive, keys: [["p", "pauses the scope"], ["h", "holds its picture to compare with"]],
    words: "What a recording writes, as it writes it; looking can neither slow nor end it. Recording is begun and ended in the terminal:  pianorig record" },
  review: { title: "Review", show: showReview, keys: TIME,
    words: "One trial under one time: force, angles measured and predicted, what the model misses, film, the action moving. Another trial or model can stand beside it. Point at a plot for its time." },
  outlines: { title: "Outlines", show: showOutlines, keys: [["Click, Enter", "on the picture: a corner"], ["\u2190 \u2191 \u2192 \u2193", "move the chosen corner by 1 px; Shift 0.1, Ctrl 10"], ["Delete", "takes it away"], ["Ctrl-Z", "takes the last change back"], ["b, [ ]", "on a later frame: choose a tracked body, turn it"]],
    words: "From a film to angles: outline the bodies on the first frame, name them, track; then look at the worst frames. Points and lines are followed without an outline." },
  action: { title: "Action", show: showAction, keys: [...TIME, ["Ctrl-Z", "takes the last change back"]],
    words: "Turn screws and parameters; the blow follows. Nothing is written: the address holds what is set, \u201cSave as TOML\u201d gives a file for --action." },
};
const SESSION = "chosen session";
/** What was chosen last, also after a view that shows no session. */
function chosen(values) {
  const name = values.get("session") || values.get("film"), trial = values.get("trial");
  if (name) sessionStorage.setItem(SESSION, JSON.stringify({ name, trial: trial === "0" ? null : trial }));
  return JSON.parse(sessionStorage.getItem(SESSION) || "{}");
}

/** The address of a view, with the session and the trial that were chosen. */
function carried(view, { name, trial }) {
  if (!name || view === "action") return `#${view}`;
  const values = view === "outlines" ? { film: name } : { session: name };
  if (trial && (view === "review" || view === "outlines")) values.trial = trial;
  return link(view, values);
}

const views = document.getElementById("views"), helped = document.getElementById("helped");
let main = document.getElementById("main"), turn = 0, leave = null;

/** Name of the view that the address asks for; the first where it names none. */
const shown = () => { const { view } = address(); return Object.hasOwn(VIEWS, view) ? view : "sessions"; };

/** Each view has a main element of its own: one that is left while it still reads cannot write into the next. */
async function show() {
  if (location.hash === "#main") { main.focus(); return; }
  const { values } = address(), view = shown(), mine = ++turn, place = main.cloneNode(false);
  leave?.();
  leave = null;
  views.replaceChildren(...Object.entries(VIEWS).map(([name, { title }]) =>
    make("li", {}, make("a", { href: carried(name, chosen(values)), "aria-current": name === view ? "page" : null }, title))));
  document.title = `${VIEWS[view].title} – piano action bench`;
  for (const key of Object.keys(place.dataset)) delete place.dataset[key];
  main.replaceWith(place);
  main = place;
  let done = null;
  try { done = await VIEWS[view].show(place, values); } catch (error) { place.append(make("p", { class: "notice", role: "alert" }, error.message)); }
  if (mine === turn) leave = done; else done?.();
}

function help() { helped.replaceChildren(...helpOf(VIEWS[shown()]), make("form", { method: "dialog" }, make("button", { class: "first" }, "Close"))); helped.showModal(); }
document.getElementById("help").addEventListener("click", help);
document.addEventListener("keydown", (event) => { if (event.key === "?" && !helped.open && !event.target.closest?.("input, textarea, select")) { event.preventDefault(); help(); } });
addEventListener("hashchange", show);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show); // what is drawn has its colours from the style
try {
  const about = await askAbout();
  document.getElementById("rights").textContent = `${about.folder} · ${about.may_write ? "may write" : "looks only"}`;
} catch (error) { say(error.message); }
show();
