// Help in place: what a view is for and its keys; the same words as docs/howto/bench_in_a_browser.md, shorter.
import { make } from "./elements.js";

const EVERYWHERE = [["Tab, Shift-Tab", "from field to field"], ["?", "this help"], ["Esc", "closes it"]];

/** Heading, words and keys of a view. */
export function helpOf({ title, words, keys }) {
  return [make("h2", {}, title), make("p", {}, words), make("dl", { class: "keys" }, ...[...keys, ...EVERYWHERE].flatMap(([key, what]) => [make("dt", {}, key), make("dd", {}, what)]))];
}
