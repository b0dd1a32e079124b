// The present force at every contact as bars on one scale, so that two contacts can be compared by eye.
import { make } from "./elements.js";

/** `labels` name the contacts; `largest` is the right end of every bar, N. */
export class ForceBars {
  constructor(labels, largest) {
    this.largest = largest;
    this.rows = labels.map((label) => {
      const bar = make("span", { class: "bar" }), value = make("td", { class: "number" });
      return { bar, value, row: make("tr", {}, make("th", { scope: "row" }, label), make("td", { class: "track" }, bar), value) };
    });
    this.element = make("table", { class: "forces" }, make("caption", {}, `Force now, N; every bar ends at ${largest.toPrecision(3)} N`), make("tbody", {}, ...this.rows.map(({ row }) => row)));
  }

  show(forces) {
    this.rows.forEach(({ bar, value }, i) => {
      bar.style.width = `${(100 * Math.max(forces[i], 0) / this.largest).toFixed(1)}%`;
      const text = forces[i] > 0.005 ? forces[i].toFixed(2) : "–";
      if (value.textContent !== text) value.textContent = text;
    });
  }
}
