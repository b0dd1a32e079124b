// Help in place: what each view is for and its keys; the same words as docs/howto/bench_in_a_browser.md, shorter.
import { VIEWS } from "./address.js";
import { make } from "./elements.js";

const EVERYWHERE = [["Tab, Shift-Tab", "from field to field"], ["?", "this help"], ["Esc", "closes it"]];
const TIME = [["Space", "plays and pauses"], ["\u2190 \u2192", "one frame, or 1 ms; with Shift ten"], ["n, p", "to the next and previous event"], ["Home, End", "to the ends"]];
const HELP = {
  sessions: ["Every folder with a session.toml. A name opens it: trials, report, annotations. What is written is only ever added.", [["Enter", "on a column's head sorts by it"]]],
  live: ["What a recording writes, as it writes it; looking can neither slow nor end it. With --control, plans are begun, paused before the next trial, resumed and aborted here. If this page vanishes, the trial ends by itself and the plan pauses.", [["p", "pauses the scope, not the plan"], ["h", "holds its picture to compare with"]]],
  review: ["One trial under one time: force, angles measured and predicted, what the model misses, film, the action moving. Another trial or model can stand beside it. Point at a plot for its time.", TIME],
  outlines: ["From a film to angles: outline the bodies on the first frame, name them, track; then look at the worst frames. Points and lines are followed without an outline.", [["Click, Enter", "on the picture: a corner"], ["\u2190 \u2191 \u2192 \u2193", "move the chosen corner by 1 px; Shift 0.1, Ctrl 10"], ["Delete", "takes it away"], ["Ctrl-Z", "takes the last change back"], ["b, [ ]", "on a later frame: choose a tracked body, turn it"]]],
  action: ["Turn screws and parameters; the blow follows. Nothing is written: the address holds what is set, \u201cSave as TOML\u201d gives a file for --action.", [...TIME, ["Ctrl-Z", "takes the last change back"]]],
};

/** Heading, words and keys of a view. */
export function helpOf(view) {
  const [words, keys] = HELP[view];
  return [make("h2", {}, VIEWS[view]), make("p", {}, words), make("dl", { class: "keys" }, ...[...keys, ...EVERYWHERE].flatMap(([key, what]) => [make("dt", {}, key), make("dd", {}, what)]))];
}
