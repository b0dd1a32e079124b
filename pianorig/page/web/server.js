// Questions to the server, and what it has told about itself: may this page write, which colour is a body's.
let about = {};

/** Said beside whatever may not be pressed. */
export const LOOK_ONLY = "This page only looks; to write, start  pianorig bench --control";

/** What the server answers; an error is its one line. */
export async function ask(path, { method = "GET", body } = {}) {
  const options = { method, headers: body ? { "Content-Type": "application/json" } : {}, body: body && JSON.stringify(body) };
  let answer;
  try { answer = await fetch(path, options); } catch { throw new Error("the bench does not answer; is  pianorig bench  still running?"); }
  const content = await answer.json();
  if (!answer.ok) throw new Error(content.error);
  return content;
}

/** Ask once, before the first view is drawn; until then nothing may be written. */
export async function askAbout() {
  about = await ask("/api/about");
  return about;
}

export const mayWrite = () => about.may_write;

/** The colour of a body, everywhere the same. */
export const colourOf = (name, i) => about.colours?.[name] || about.other_colours?.[i % about.other_colours.length] || "#767676";

/** A name as a part of a path. */
export const at = (name) => encodeURIComponent(name);
