// Lamps of a recording: how much of each limit the trial has used, the watchdog, the disk, what stopped the last trial.
import { make } from "./elements.js";

const NEAR = 0.8, STALE_S = 0.5;
const TITLES = { force: "Force", "force rate": "Force rate", travel: "Travel", speed: "Speed" };
const WORDS = { good: "✓", near: "▲ near its limit", bad: "✕ beyond its limit", off: "○" };

/** A row of lamps; a lamp tells its state by sign, word and colour. */
export function lampRow() {
  const row = make("ul", { class: "lamps", "aria-label": "Interlocks" }), note = make("p", { class: "hint" });
  const lamps = new Map();

  function lamp(name, state, text, share = null) {
    if (!lamps.has(name)) {
      const parts = { word: make("span", { class: "word" }), text: make("span", { class: "values" }), bar: make("span", { class: "bar" }) };
      parts.item = make("li", {}, make("span", { class: "title" }, name), " ", parts.word, make("br"), parts.text, make("span", { class: "track", "aria-hidden": "true" }, parts.bar));
      lamps.set(name, parts);
      row.append(parts.item);
    }
    const parts = lamps.get(name), set = (node, value) => { if (node.textContent !== value) node.textContent = value; };
    if (parts.item.className !== `lamp ${state}`) parts.item.className = `lamp ${state}`;
    set(parts.word, WORDS[state]);
    set(parts.text, text);
    parts.bar.parentElement.hidden = share === null;
    if (share !== null) parts.bar.style.width = `${(100 * Math.min(share, 1)).toFixed(1)}%`;
  }

  return {
    element: make("section", { "aria-label": "Interlocks and watchdog" }, row, note),
    /** What the server says of limits; `since_s` is the age of the newest sample that came, null where none has. */
    set(now, recording, since_s) {
      for (const title of Object.values(TITLES)) {
        const use = now.uses.find((one) => TITLES[one.what] === title);
        if (!use) { lamp(title, "off", "not seen yet", 0); continue; }
        const share = use.share === null ? Infinity : use.share, state = share >= 1 ? "bad" : share >= NEAR ? "near" : "good";
        const number = (x) => (x === null ? "no number" : Number(x.toPrecision(3)).toString());
        lamp(title, state, `${use.where ? `${use.where} ` : ""}${number(use.value)} of ${number(use.limit)} ${use.unit}, ${(100 * share).toFixed(0)} %`, share);
      }
      const silent = recording && since_s !== null && since_s > STALE_S;
      if (now.watchdog_s === null) lamp("Watchdog", "off", now.problem ? "not known" : "none in the rig file");
      else {
        const tripped = /WatchdogTripped/.test(now.ended?.reason || "") && !recording;
        lamp("Watchdog", tripped || (silent && since_s > now.watchdog_s) ? "bad" : silent ? "near" : recording ? "good" : "off",
          tripped ? "has made the outputs safe" : recording && since_s !== null ? `${now.watchdog_s} s; last data ${since_s < 0.1 ? "now" : `${since_s.toFixed(1)} s ago`}` : `${now.watchdog_s} s, no trial`);
      }
      const ended = now.ended && !recording ? now.ended : null;
      lamp("Last trial", ended ? "bad" : "good", ended ? `trial ${ended.trial}: ${ended.status}${ended.reason ? `, ${ended.reason}` : ""}` : "nothing stopped it");
      note.textContent = now.problem ? `Limits are not known: ${now.problem}` : "Largest values of this trial beside the rig file's limits. What stopped a trial is the recorder's own reason.";
    },
  };
}
