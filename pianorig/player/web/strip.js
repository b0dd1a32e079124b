// Curves over time on one canvas, each on its own scale, with the player's cursor.
import { make } from "./elements.js";
import { valueAt } from "./numbers.js";

const WIDTH = 900, ROW = 70, LEFT = 8;

/** `curves`: [{title, unit, color, time, value, beside: {time, value}}]; `pick(t)` is called when a time is pointed at. */
export class Strip {
  constructor(curves, { from, to, pick }) {
    Object.assign(this, { curves, from, to });
    this.canvas = make("canvas", { width: WIDTH, height: ROW * curves.length, role: "img", "aria-label": `${curves.map(({ title }) => title).join(", ")} over time` });
    this.cursor = make("div", { class: "cursor", "aria-hidden": "true" });
    this.element = make("div", { class: "strip" }, this.canvas, this.cursor);
    this.canvas.addEventListener("pointerdown", (event) => { const box = this.canvas.getBoundingClientRect(); pick(from + (to - from) * (event.clientX - box.left) / box.width); });
    const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    const pen = this.pen = this.canvas.getContext("2d");
    this.draw = () => {
      pen.clearRect(0, 0, WIDTH, this.canvas.height);
      curves.forEach((curve, k) => {
        const lines = [curve, ...(curve.beside ? [curve.beside] : [])];
        let low = Infinity, high = -Infinity;
        for (const { value } of lines) for (const v of value) { if (v < low) low = v; if (v > high) high = v; }
        if (!(low < high)) high = low + 1;
        const y = (v) => ROW * (k + 1) - 6 - (ROW - 26) * (v - low) / (high - low);
        pen.strokeStyle = style("--line");
        pen.strokeRect(0, ROW * k + 18, WIDTH, ROW - 22);
        lines.forEach((line, n) => {
          pen.strokeStyle = n ? style("--ink") : curve.color || style("--ink");
          pen.setLineDash(n ? [5, 4] : []);
          pen.lineWidth = n ? 1.2 : 1.6;
          pen.beginPath();
          line.value.forEach((v, i) => { if (Number.isFinite(v)) pen.lineTo(WIDTH * (line.time[i] - from) / (to - from), y(v)); });
          pen.stroke();
        });
        pen.setLineDash([]);
        pen.fillStyle = style("--ink");
        pen.font = "13px system-ui, sans-serif";
        const now = valueAt(curve.time, curve.value, this.time ?? from);
        pen.fillText(`${curve.title}  ${Number.isFinite(now) ? now.toFixed(2) : "–"} ${curve.unit}, ${low.toFixed(2)} to ${high.toFixed(2)}`, LEFT, ROW * k + 13);
      });
    };
  }

  at(t) {
    this.time = t;
    this.draw();
    this.cursor.style.left = `${100 * (t - this.from) / (this.to - this.from)}%`;
  }
}
