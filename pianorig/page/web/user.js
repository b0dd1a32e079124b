// What is handed to the user from any view: a line at the foot of the page, a text as a file.
import { make } from "./elements.js";

const SHOWN_MS = 9000;
const said = document.getElementById("said");
let quiet = null;

/** Show a line for a while; screen readers read it. */
export function say(text) {
  said.textContent = text;
  clearTimeout(quiet);
  quiet = setTimeout(() => { said.textContent = ""; }, SHOWN_MS);
}

/** Give the user a text as a file; nothing is written by the server. */
export function download(text, name, type) {
  const url = URL.createObjectURL(new Blob([text], { type }));
  make("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}
