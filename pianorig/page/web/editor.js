// Outlines on a frame, edited by pointer and keys. Points are film pixels, centres at whole numbers, y down.
import { colourOf } from "./server.js";

const REACH_PX = 9, TURN_RAD = 0.5 * Math.PI / 180, MOST_UNDONE = 200;

export class OutlineEditor {
  /** `told(bodies, dirty)` is called after every change. */
  constructor(panel, bodies, told) {
    Object.assign(this, { panel, told, bodies: structuredClone(bodies), chosen: 0, point: -1, before: [], placed: new Map() });
    panel.after = (pen, index) => this.draw(pen, index);
    const canvas = panel.canvas;
    canvas.tabIndex = 0;
    canvas.style.cursor = "crosshair";
    canvas.style.touchAction = "none";
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", () => { this.held = null; });
    canvas.addEventListener("pointercancel", () => { this.held = null; });
    this.keys = (event) => this.key(event);
    document.addEventListener("keydown", this.keys);
  }

  close() { document.removeEventListener("keydown", this.keys); this.panel.after = null; }

  color(i) { return colourOf(this.bodies[i].name, i); }

  keep() { this.before.push(JSON.stringify(this.bodies)); if (this.before.length > MOST_UNDONE) this.before.shift(); }

  undo() {
    if (!this.before.length) return;
    this.bodies = JSON.parse(this.before.pop());
    this.chosen = Math.min(this.chosen, Math.max(this.bodies.length - 1, 0));
    this.point = -1;
    this.changed();
  }

  changed(dirty = true) { this.told(this.bodies, dirty); this.panel.draw(this.panel.shown); }

  choose(i) { for (const body of this.bodies) delete body.open; this.chosen = i; this.point = -1; this.changed(false); this.panel.canvas.focus(); }


  add() {
    this.keep();
    let n = this.bodies.length + 1;
    while (this.bodies.some((body) => body.name === `body${n}`)) n++;
    this.bodies.push({ name: `body${n}`, parent: "", layer: 0, points: [] });
    this.choose(this.bodies.length - 1);
    this.changed();
  }

  remove(i) {
    this.keep();
    const [gone] = this.bodies.splice(i, 1);
    for (const body of this.bodies) if (body.parent === gone.name) body.parent = "";
    this.chosen = Math.min(this.chosen, Math.max(this.bodies.length - 1, 0));
    this.point = -1;
    this.changed();
  }

  /** Film pixel under the pointer. */
  where(event) {
    return this.panel.pixel(event).map((x) => Math.round(10 * x) / 10);
  }

  reach() { return REACH_PX * this.panel.film.width / this.panel.canvas.getBoundingClientRect().width / this.panel.zoom; }

  down(event) {
    if (event.button !== 0) return;
    this.panel.canvas.focus();
    this.panel.canvas.setPointerCapture(event.pointerId);
    const [x, y] = this.where(event);
    const tracked = this.panel.shown > 0 ? this.trackedAt(x, y) : null;
    if (tracked) { this.held = { tracked, x, y }; return; }
    if (this.panel.shown > 0) { this.elsewhere?.(); return; }
    if (!this.bodies.length) this.add();
    const body = this.bodies[this.chosen], near = (points) => {
      let best = -1, least = this.reach();
      points.forEach(([px, py], k) => { const away = Math.hypot(px - x, py - y); if (away < least) { least = away; best = k; } });
      return best;
    };
    this.keep();
    this.point = near(body.points);
    if (this.point === 0) delete body.open; // back at its first corner, an outline is closed
    if (this.point < 0) {
      const other = this.bodies.findIndex((one, i) => i !== this.chosen && near(one.points) >= 0);
      if (other >= 0) { this.chosen = other; this.point = near(this.bodies[other].points); this.before.pop(); } else this.insert(body, x, y);
    }
    this.held = { point: this.point };
    this.changed();
  }

  /** A new point, between the two whose edge it is nearest to. */
  insert(body, x, y) {
    const n = body.points.length;
    let place = n;
    if (n >= 3) {
      let least = Infinity;
      for (let k = 0; k < n; k++) {
        const [ax, ay] = body.points[k], [bx, by] = body.points[(k + 1) % n], ex = bx - ax, ey = by - ay;
        const along = Math.min(Math.max(((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey || 1), 0), 1);
        const away = Math.hypot(ax + along * ex - x, ay + along * ey - y);
        // drawn corner after corner, the next point belongs at the end although an edge may pass nearby
        if (away < least - 1e-9) { least = away; place = k + 1; }
      }
      if (body.open) place = n;
    } else body.open = true;
    body.points.splice(place, 0, [x, y]);
    this.point = place;
  }

  move(event) {
    if (!this.held) return;
    const [x, y] = this.where(event);
    if (this.held.tracked) { this.drag(this.held.tracked, x - this.held.x, y - this.held.y); this.held.x = x; this.held.y = y; return; }
    this.bodies[this.chosen].points[this.held.point] = [x, y];
    this.changed();
  }

  key(event) {
    if ((event.ctrlKey || event.metaKey) && event.key === "z" && !event.target.closest?.("input, textarea")) { event.preventDefault(); this.undo(); return; }
    if (document.activeElement !== this.panel.canvas || event.altKey || event.metaKey) return;
    const by = event.shiftKey ? 0.1 : event.ctrlKey ? 10 : 1;
    if (event.key === "Enter" || (event.key === "b" && this.panel.shown > 0)) { event.preventDefault(); if (event.key === "b") this.next(); else this.corner(); return; }
    const steps = { ArrowLeft: [-by, 0], ArrowRight: [by, 0], ArrowUp: [0, -by], ArrowDown: [0, by] };
    const body = this.bodies[this.chosen];
    if ((event.key === "[" || event.key === "]") && this.last) { event.preventDefault(); this.turn(this.last, event.key === "[" ? -TURN_RAD : TURN_RAD); return; }
    if (event.key in steps && this.panel.shown > 0) {
      event.preventDefault();
      if (this.last) this.drag(this.last, ...steps[event.key]);
    } else if (event.key in steps && body && this.point >= 0) {
      event.preventDefault();
      this.keep();
      const [dx, dy] = steps[event.key], [x, y] = body.points[this.point];
      body.points[this.point] = [Math.round(10 * (x + dx)) / 10, Math.round(10 * (y + dy)) / 10];
      this.changed();
    } else if ((event.key === "Delete" || event.key === "Backspace") && body && this.point >= 0) {
      event.preventDefault();
      this.keep();
      body.points.splice(this.point, 1);
      this.point = Math.min(this.point, body.points.length - 1);
      this.changed();
    }
  }

  /** By keyboard: a corner beside the chosen one, or in the middle, to be moved by the arrows. */
  corner() {
    if (this.panel.shown > 0) { this.elsewhere?.(); return; }
    if (!this.bodies.length) this.add();
    const body = this.bodies[this.chosen], { width, height } = this.panel.film, from = body.points[this.point];
    this.keep();
    const [x, y] = from ? [Math.min(from[0] + 10, width - 1), from[1]] : [Math.round(width / 2), Math.round(height / 2)];
    if (from && !body.open) { body.points.splice(this.point + 1, 0, [x, y]); this.point += 1; } else { body.points.push([x, y]); body.open = true; this.point = body.points.length - 1; }
    this.changed();
  }

  /** By keyboard: the next tracked body of this frame is the one that is placed. */
  next() {
    const there = this.panel.bodies.filter((body) => this.pose(body, this.panel.shown));
    if (!there.length) return;
    const body = there[(there.indexOf(this.last) + 1) % there.length];
    this.place(body, this.pose(body, this.panel.shown));
  }

  /** Pose of a tracked body in the shown frame: as placed by hand, as found, or where it was last seen; null before that. */
  pose(body, index) {
    const placed = this.placed.get(body.name);
    if (placed) return { turn: -placed[0], x: placed[1], y: placed[2] };
    let row = body.row.get(index);
    if (row === undefined) return null;
    while (row >= 0 && !Number.isFinite(body.turn[row])) row--;
    return row < 0 ? null : { turn: body.turn[row], x: body.x[row], y: body.y[row] };
  }

  corners(body, { turn, x, y }) {
    const c = Math.cos(turn), s = Math.sin(turn);
    return body.points.map(([px, py]) => [x + c * px - s * py, y + s * px + c * py]);
  }

  trackedAt(x, y) {
    for (const body of [...this.panel.bodies].reverse()) {
      const pose = this.pose(body, this.panel.shown);
      if (!pose) continue;
      const points = this.corners(body, pose);
      let inside = false;
      points.forEach(([ax, ay], k) => {
        const [bx, by] = points[(k + 1) % points.length];
        if ((ay > y) !== (by > y) && x < ax + (bx - ax) * (y - ay) / (by - ay)) inside = !inside;
      });
      if (inside) return body;
    }
    return null;
  }

  drag(body, dx, dy) { const pose = this.pose(body, this.panel.shown); this.place(body, { ...pose, x: pose.x + dx, y: pose.y + dy }); }

  turn(body, by) { const pose = this.pose(body, this.panel.shown); if (pose) this.place(body, { ...pose, turn: pose.turn + by }); }

  place(body, { turn, x, y }) {
    this.last = body;
    this.placed.set(body.name, [-turn, x, y]); // the table counts angles counter-clockwise, y up
    this.panel.draw(this.panel.shown);
    this.onPlaced?.();
  }

  forgetPlaces() { this.placed.clear(); this.last = null; }

  draw(pen, index) {
    const { scale: k, zoom } = this.panel, to = ([x, y]) => [k * (x + 0.5), k * (y + 0.5)];
    const path = (points, color, width, dash = []) => {
      pen.beginPath();
      for (const point of points) pen.lineTo(...to(point));
      if (points.length > 2) pen.closePath();
      pen.setLineDash(dash.map((d) => d / zoom));
      for (const [shade, broad] of [["#000000", width + 1.8], [color, width]]) { pen.strokeStyle = shade; pen.lineWidth = broad / zoom; pen.stroke(); }
      pen.setLineDash([]);
    };
    for (const body of this.panel.bodies) if (this.placed.has(body.name)) path(this.corners(body, this.pose(body, index)), "#ffffff", 1.8, [6, 4]);
    if (index > 0 && this.panel.bodies.length) return; // tracked outlines are drawn by the panel; those of the still frames would mislead
    this.bodies.forEach((body, i) => {
      const mine = i === this.chosen;
      path(body.points, this.color(i), mine ? 2.4 : 1.6, index > 0 ? [5, 4] : []);
      if (!mine || index > 0) return;
      body.points.forEach((point, n) => {
        const [x, y] = to(point);
        pen.beginPath();
        pen.arc(x, y, (n === this.point ? 6 : 4) / zoom, 0, 7);
        pen.fillStyle = n === this.point ? "#ffffff" : this.color(i);
        pen.fill();
        pen.strokeStyle = "#000000";
        pen.lineWidth = 1.2 / zoom;
        pen.stroke();
      });
    });
  }
}
