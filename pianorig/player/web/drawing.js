// The action moving: bodies as the model places them, and as they were measured, over or beside each other.
import { make } from "./elements.js";
import { ForceBars } from "./forces.js";
import { indexAt, unpack } from "./numbers.js";

const WIDTH = 900, MARGIN = 12, GLOW_PX2_PER_N = 40;

export class Drawing {
  constructor(data, title = "Action", { forces = false } = {}) {
    this.title = title;
    this.canvas = make("canvas", { width: WIDTH, height: 400, role: "img", "aria-label": `${title}, side view` });
    this.beside = make("input", { type: "checkbox", onchange: () => { this.fit(); this.at(this.time); } });
    this.legend = make("span");
    this.values = make("span", { class: "values" });
    this.measuredToo = make("label", {}, this.beside, "measured above, model below");
    this.key = make("span", { class: "hint" });
    this.bars = make("details", { open: forces, ontoggle: () => { if (this.bars.open && this.time !== undefined) this.at(this.time); } }, make("summary", {}, "Force at every contact, on one scale"));
    this.element = make("section", { class: "drawing", "aria-label": title },
      make("div", { class: "head" }, make("span", { class: "title" }, title), this.values), this.canvas,
      make("div", { class: "row" }, this.measuredToo, this.legend), this.key, this.bars);
    this.set(data);
  }

  /** Show another motion of the same or another action. */
  set(data) {
    this.data = { ...data, time: unpack(data.time_s), pose: unpack(data.pose), measured: unpack(data.measured), point: unpack(data.point_m), normal: unpack(data.normal_n) };
    this.measuredToo.hidden = !this.data.measured;
    this.key.textContent = this.data.measured ? "Broad: measured. Thin: model. Orange: force at a contact, area in proportion." : "Orange: force at a contact, area in proportion.";
    const names = data.bodies.map((body) => body.name).join();
    if (names !== this.names) this.legend.replaceChildren(...data.bodies.map((body) => make("span", { class: "body" }, make("span", { class: "swatch", style: `background:${body.color}` }), body.name)));
    this.names = names;
    this.setBars();
    this.fit();
    if (this.time !== undefined) this.at(this.time);
  }

  /** Every bar ends at the largest force of all contacts. */
  setBars() {
    const { labels, contacts, normal } = this.data;
    let largest = 0;
    for (const force of normal) if (force > largest) largest = force;
    const key = `${(labels || contacts).join()} ${largest}`;
    if (key === this.barsOf) return;
    this.barsOf = key;
    this.forces = new ForceBars(labels || contacts, largest || 1);
    this.bars.replaceChildren(this.bars.firstChild, this.forces.element);
  }

  /** Scale to what is ever reached. */
  fit() {
    const { bodies, ground, pose, time } = this.data, n = bodies.length;
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    const meet = (x, y) => { low[0] = Math.min(low[0], x); low[1] = Math.min(low[1], y); high[0] = Math.max(high[0], x); high[1] = Math.max(high[1], y); };
    for (const curve of ground) for (const [x, y] of curve) meet(x, y);
    const step = Math.max(1, Math.floor(time.length / 60));
    for (let row = 0; row < time.length; row += step) {
      bodies.forEach((body, i) => {
        const [px, py, turn] = pose.subarray(3 * (row * n + i)), c = Math.cos(turn), s = Math.sin(turn);
        for (const curve of [...body.surfaces, ...body.sticks]) for (const [x, y] of curve) meet(px + c * x - s * y, py + s * x + c * y);
      });
    }
    this.scale = (WIDTH - 2 * MARGIN) / (high[0] - low[0]);
    this.one = Math.ceil(this.scale * (high[1] - low[1]) + 2 * MARGIN);
    this.origin = [MARGIN - this.scale * low[0], MARGIN + this.scale * high[1]];
    this.canvas.height = this.one * (this.data.measured && this.beside.checked ? 2 : 1);
  }

  at(t) {
    this.time = t;
    const { time, measured } = this.data, pen = this.canvas.getContext("2d");
    const row = Math.min(indexAt(time, t), Math.max(time.length - 2, 0));
    const share = time.length > 1 ? Math.min(Math.max((t - time[row]) / (time[row + 1] - time[row]), 0), 1) : 0;
    const style = getComputedStyle(document.documentElement);
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.lineCap = pen.lineJoin = "round";
    const below = measured && this.beside.checked ? this.one : 0;
    if (measured) this.action(pen, measured, row, share, 0, style, true);
    this.action(pen, this.data.pose, row, share, below, style, false);
    this.glow(pen, row, below);
    if (this.bars.open) this.forces.show(this.data.normal.subarray(row * this.data.contacts.length, (row + 1) * this.data.contacts.length));
    this.canvas.dataset.time = t;
  }

  action(pen, pose, row, share, down, style, broad) {
    const { bodies, ground } = this.data, n = bodies.length, k = this.scale, [x0, y0] = this.origin;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.strokeStyle = style.getPropertyValue("--soft");
    pen.lineWidth = 1.5;
    for (const curve of ground) this.path(pen, curve, x0, y0 + down, 1, 0, k);
    bodies.forEach((body, i) => {
      const a = pose.subarray(3 * (row * n + i)), b = pose.subarray(3 * ((row + 1) * n + i));
      const [x, y, turn] = [0, 1, 2].map((q) => (b.length > q ? a[q] + share * (b[q] - a[q]) : a[q]));
      if (!Number.isFinite(turn)) return;
      const c = Math.cos(turn), s = Math.sin(turn), px = x0 + k * x, py = y0 + down - k * y;
      pen.strokeStyle = body.color;
      pen.globalAlpha = broad ? 0.45 : 1;
      pen.lineWidth = broad ? 9 : 2;
      for (const pair of body.sticks) this.path(pen, pair, px, py, c, s, k);
      pen.lineWidth = broad ? 4 : 2;
      for (const curve of body.surfaces) this.path(pen, curve, px, py, c, s, k);
      pen.globalAlpha = 1;
      pen.beginPath();
      pen.arc(px, py, broad ? 5 : 3, 0, 7);
      pen.stroke();
    });
  }

  path(pen, points, px, py, c, s, k) {
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(px + k * (c * x - s * y), py - k * (s * x + c * y));
    pen.stroke();
  }

  glow(pen, row, down) {
    const { contacts, point, normal } = this.data, m = contacts.length, k = this.scale, [x0, y0] = this.origin;
    const told = [];
    pen.fillStyle = "#FF7F0E";
    pen.globalAlpha = 0.75;
    for (let c = 0; c < m; c++) {
      const force = normal[row * m + c];
      if (!(force > 0.005)) continue;
      told.push(force);
      pen.beginPath();
      pen.arc(x0 + k * point[2 * (row * m + c)], y0 + down - k * point[2 * (row * m + c) + 1], Math.sqrt(GLOW_PX2_PER_N * force / Math.PI), 0, 7);
      pen.fill();
    }
    pen.globalAlpha = 1;
    this.values.textContent = told.length ? `${told.length} contacts closed, largest force ${Math.max(...told).toFixed(2)} N` : "no contact closed";
  }
}
