// A button that begins long work, and its progress; a reload finds the work again.
import { make } from "./elements.js";
import { ask } from "./server.js";
import { say } from "./user.js";

const EVERY_MS = 400;

/** `begin()` asks the server for the work; `done()` is called when it has succeeded, `ended()` tells whether the view is gone. */
export function jobButton({ kept, title, disabled, hint, begin, done, ended }) {
  const button = make("button", { type: "button", class: "first", disabled, title: disabled ? hint : null, onclick: start }, title);
  const stop = make("button", { type: "button", hidden: true }, "Stop");
  const bar = make("progress", { hidden: true, max: 1, "aria-label": `Progress of ${title}` });
  const lines = make("pre", { class: "lines", hidden: true, role: "log", "aria-label": `Messages of ${title}`, tabindex: "0" });

  async function follow(number) {
    button.disabled = true;
    stop.hidden = lines.hidden = bar.hidden = false;
    bar.removeAttribute("value");
    stop.onclick = () => ask(`/api/jobs/${number}`, { method: "DELETE" }).catch((error) => say(error.message));
    for (;;) {
      let job;
      try { job = await ask(`/api/jobs/${number}`); } catch (error) { finish(); lines.textContent = error.message; return; }
      const share = job.lines.map((line) => line.match(/^\S+ (\d+)\/(\d+)$/)).filter(Boolean).pop();
      if (share) bar.value = share[1] / share[2];
      const rest = job.lines.filter((line) => !/^\S+ \d+\/\d+$/.test(line));
      lines.textContent = rest.join("\n") || (share ? share[0] : "starting …");
      if (!job.running) { finish(); if (!job.failed && !ended()) await done(); return; }
      if (ended()) return;
      await new Promise((go) => setTimeout(go, EVERY_MS));
    }
  }

  function finish() {
    sessionStorage.removeItem(kept);
    button.disabled = disabled;
    stop.hidden = bar.hidden = true;
  }

  async function start() {
    try {
      const job = await begin();
      sessionStorage.setItem(kept, job.job);
      await follow(job.job);
    } catch (error) { say(error.message); }
  }

  if (sessionStorage.getItem(kept)) follow(sessionStorage.getItem(kept));
  return make("div", { class: "job" }, button, " ", stop, " ", bar, lines);
}
