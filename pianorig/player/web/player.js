// One time cursor: a slider, play at a chosen speed, steps from frame to frame, jumps to events; all of it by keys too.
import { make } from "./elements.js";

const SPEEDS = [["0.001", "1000 × slower"], ["0.004", "250 × slower"], ["0.01", "100 × slower"], ["0.05", "20 × slower"], ["0.25", "4 × slower"], ["1", "true speed"]];
const TYPING = "input, textarea, select";

/**
 * Player of the interval from–to (s). `steps` are the times of frames, or null for steps of 1 ms; `events` have time_s and title.
 * `show(t)` draws a time; it is called at most once per picture of the screen.
 */
export class Player {
  constructor({ from, to, at, steps, events, show }) {
    Object.assign(this, { from, to, steps, events, show });
    this.time = Math.min(Math.max(at ?? from, from), to);
    this.running = false;
    this.pending = 0;
    this.button = make("button", { type: "button", class: "first", onclick: () => this.run(!this.running) }, "Play");
    this.slider = make("input", { type: "range", min: from, max: to, step: "any", "aria-label": "Time", oninput: () => { this.run(false); this.go(Number(this.slider.value)); } });
    this.speed = make("select", { "aria-label": "Speed" }, ...SPEEDS.map(([value, title]) => make("option", { value }, title)));
    this.speed.value = "0.004";
    this.slower = make("input", { type: "number", min: "0.1", max: "100000", step: "any", value: 1 / this.speed.value, "aria-label": "How many times slower", onchange: () => this.slow(Number(this.slower.value)) });
    this.speed.addEventListener("change", () => { if (this.speed.value) this.slower.value = 1 / this.speed.value; });
    this.now = make("output", { class: "now" });
    const moments = make("select", { "aria-label": "Go to event", hidden: !events.length, onchange: () => { if (moments.value) { this.run(false); this.go(Number(moments.value)); moments.value = ""; } } },
      make("option", { value: "" }, "Go to event …"),
      ...events.map((event) => make("option", { value: event.time_s, title: event.meaning }, `${event.title} (${event.source}) ${(1000 * event.time_s).toFixed(2)} ms`)));
    const step = (name, title, sign) => make("button", { type: "button", "aria-label": title, title, onclick: () => this.step(sign) }, name);
    this.element = make("div", { class: "player", role: "group", "aria-label": "Time" },
      make("div", { class: "row" }, this.button, step("\u2190", steps ? "One frame back" : "1 ms back", -1), step("\u2192", steps ? "One frame on" : "1 ms on", 1), this.speed, make("label", {}, "or", this.slower, "× slower"), moments, this.now), this.slider);
    this.keys = (event) => this.key(event);
    document.addEventListener("keydown", this.keys);
    this.go(this.time);
  }

  close() {
    this.running = false;
    document.removeEventListener("keydown", this.keys);
  }

  /** Any speed: so many times slower than true; below 1 faster. */
  slow(times) {
    if (!(times >= 0.1 && times <= 1e5)) { this.slower.value = 1 / this.rate(); return; }
    const value = String(1 / times), known = [...this.speed.options].find((one) => Math.abs(one.value * times - 1) < 1e-9);
    let own = this.speed.querySelector("[data-own]");
    if (!known) {
      own ??= this.speed.appendChild(make("option", { "data-own": true }));
      own.value = value;
      own.textContent = `${times} × slower`;
    }
    this.speed.value = known ? known.value : value;
  }

  rate() { return Number(this.speed.value); }

  go(t) {
    this.time = Math.min(Math.max(t, this.from), this.to);
    if (!this.pending) this.pending = requestAnimationFrame(() => { this.pending = 0; this.draw(); });
  }

  draw() {
    this.slider.value = this.time;
    const text = `${(1000 * this.time).toFixed(2)} ms`;
    this.now.textContent = text;
    this.slider.setAttribute("aria-valuetext", text);
    this.show(this.time);
  }

  run(is) {
    if (is === this.running) return;
    this.running = is;
    this.button.textContent = is ? "Pause" : "Play";
    if (!is) return;
    if (this.time >= this.to) this.time = this.from;
    let before = null;
    const tick = (stamp) => {
      if (!this.running) return;
      if (before !== null) {
        this.time += (stamp - before) / 1000 * this.rate();
        if (this.time >= this.to) { this.time = this.to; this.run(false); }
        this.draw();
      }
      before = stamp;
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  /** So many frames, or milliseconds where there is no film, on or back. */
  step(count) {
    this.run(false);
    if (!this.steps) { this.go(this.time + count / 1000); return; }
    let i = 0, least = Infinity;
    this.steps.forEach((t, k) => { if (Math.abs(t - this.time) < least) { least = Math.abs(t - this.time); i = k; } });
    this.go(this.steps[Math.min(Math.max(i + count, 0), this.steps.length - 1)]);
  }

  /** The next event in a direction. */
  jump(sign) {
    this.run(false);
    const ahead = this.events.map((event) => event.time_s).filter((t) => sign * (t - this.time) > 1e-7).sort((a, b) => sign * (a - b));
    if (ahead.length) this.go(ahead[0]);
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || (event.target !== this.slider && event.target.closest?.(TYPING))) return;
    if (event.key === " " && event.target.closest?.("button, a, summary")) return;
    const many = event.shiftKey ? 10 : 1;
    const actions = {
      " ": () => this.run(!this.running), ArrowLeft: () => this.step(-many), ArrowRight: () => this.step(many),
      n: () => this.jump(1), p: () => this.jump(-1), Home: () => { this.run(false); this.go(this.from); }, End: () => { this.run(false); this.go(this.to); },
    };
    if (!(event.key in actions)) return;
    event.preventDefault();
    actions[event.key]();
  }
}

export const KEYS = "Keys: space plays and pauses, ← and → go one frame (with Shift ten), n and p to the next and previous event, Home and End to the ends.";
