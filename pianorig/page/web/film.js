// A film's frames with the tracked outlines: only what is looked at is fetched, and a little ahead of it.
import { make } from "./elements.js";
import { nearest, unpack } from "./numbers.js";
import { at } from "./server.js";
import { download } from "./user.js";

const KEPT_BYTES = 64e6, CHUNK_BYTES = 1e6, CHUNK = 8, AT_ONCE = 3;
const STEP = 1.25, MOST_ZOOM = 16, LEAST_BOX_PX = 8; // of a turn of the wheel; a smaller box is none
const NOWHERE = "\u00a0"; // keeps its line, so that the picture does not move under the pointer

/** Frames come in chunks, a byte a pixel; those far from where one looks are forgotten. */
export class FilmPanel {
  constructor(session, trial, film) {
    this.film = film;
    this.base = `/film/${at(session)}/${trial}/`;
    this.bytes = film.width * film.height;
    this.many = Math.max(1, Math.min(CHUNK, Math.floor(CHUNK_BYTES / this.bytes)));
    this.most = Math.max(6, Math.floor(KEPT_BYTES / (this.bytes * this.many)));
    this.kept = new Map();
    this.asked = new Set();
    this.wanted = this.shown = -1;
    this.drawn = 0;
    this.way = 1;
    this.plain = new OffscreenCanvas(film.width, film.height);
    this.image = new ImageData(film.width, film.height);
    this.scale = Math.max(1, Math.min(3, Math.round(900 / film.width)));
    this.legend = make("span");
    this.setBodies(film.bodies);
    this.canvas = make("canvas", { width: film.width * this.scale, height: film.height * this.scale, role: "img", "aria-label": `Film ${film.name} with tracked outlines` });
    this.label = make("span", { class: "values" });
    this.pointed = make("span", { class: "hint" }, NOWHERE);
    this.zoom = 1;
    this.corner = [0, 0]; // of what is shown, px of the canvas as it is without zoom
    this.box = make("div", { class: "box", "aria-hidden": "true", hidden: true });
    this.listen();
    this.outlined = make("input", { type: "checkbox", checked: true, onchange: () => this.draw(this.shown) });
    this.element = make("section", { class: "film", "aria-label": "Film" },
      make("div", { class: "head" }, make("span", { class: "title" }, film.name), this.label, this.pointed),
      make("div", { class: "picture" }, this.canvas, this.box),
      make("div", { class: "row tools" }, make("label", {}, this.outlined, "outlines"), this.legend,
        make("button", { type: "button", "aria-label": "Zoom into the film", onclick: () => this.zoomAt(this.middle(), STEP ** 2) }, "+"),
        make("button", { type: "button", "aria-label": "Zoom out of the film", onclick: () => this.zoomAt(this.middle(), STEP ** -2) }, "−"),
        make("button", { type: "button", onclick: () => this.zoomAt([0, 0], 0) }, "Whole frame"),
        make("button", { type: "button", onclick: () => this.save() }, "Save frame")),
      film.note ? make("p", { class: "stale" }, film.note) : null);
  }

  /** The tracked outlines, now or after tracking again. */
  setBodies(bodies) {
    this.bodies = bodies.map((body) => ({ ...body, turn: unpack(body.turn), x: unpack(body.x), y: unpack(body.y), row: new Map(body.frame.map((f, i) => [f, i])) }));
    this.legend.replaceChildren(...this.bodies.map((body) => make("span", { class: "body" }, make("span", { class: "swatch", style: `background:${body.color}` }), body.name)));
  }

  /** Where the pointer is, px of the canvas as it is without zoom. */
  under(event) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const share = [(event.clientX - left) / width * this.canvas.width, (event.clientY - top) / height * this.canvas.height];
    return share.map((x, k) => x / this.zoom + this.corner[k]);
  }

  /** Film pixel under the pointer, centres at whole numbers. */
  pixel(event) { return this.under(event).map((x) => x / this.scale - 0.5); }

  middle() { return [this.corner[0] + this.canvas.width / 2 / this.zoom, this.corner[1] + this.canvas.height / 2 / this.zoom]; }

  /** So many times as large, 0 the whole frame; the place that is named stays where it is. */
  zoomAt(place, times) {
    const before = this.zoom;
    this.zoom = Math.min(Math.max(before * times, 1), MOST_ZOOM);
    this.look(place.map((x, k) => x - (x - this.corner[k]) * before / this.zoom));
  }

  look(corner) {
    const sizes = [this.canvas.width, this.canvas.height];
    this.corner = corner.map((x, k) => Math.min(Math.max(x, 0), sizes[k] * (1 - 1 / this.zoom)));
    this.canvas.dataset.zoom = this.zoom.toFixed(3);
    this.draw(this.shown);
  }

  /** The wheel and a box drawn with Shift zoom; the grey value under the pointer is told. */
  listen() {
    const canvas = this.canvas;
    let begun = null;
    canvas.addEventListener("wheel", (event) => {
      const is_out = event.deltaY > 0;
      if (event.ctrlKey || (is_out && this.zoom <= 1)) return; // the page scrolls
      event.preventDefault();
      this.zoomAt(this.under(event), is_out ? 1 / STEP : STEP);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || !event.shiftKey) return;
      event.stopImmediatePropagation(); // an outline gets no corner there
      begun = event;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (begun) { event.stopImmediatePropagation(); this.drawBox(begun, event); }
      const [x, y] = this.pixel(event), column = Math.round(x), row = Math.round(y), grey = this.grey(this.shown);
      const is_inside = column >= 0 && row >= 0 && column < this.film.width && row < this.film.height;
      this.pointed.textContent = is_inside && grey ? `x ${x.toFixed(1)}, y ${y.toFixed(1)} px: grey ${grey[row * this.film.width + column]}` : NOWHERE;
    });
    const end = (event) => {
      if (!begun) return;
      event.stopImmediatePropagation();
      const [a, b] = [this.under(begun), this.under(event)], sizes = a.map((x, k) => Math.abs(b[k] - x));
      const is_box = event.type === "pointerup" && Math.max(Math.abs(event.clientX - begun.clientX), Math.abs(event.clientY - begun.clientY)) >= LEAST_BOX_PX;
      begun = null;
      this.box.hidden = true;
      if (!is_box) return;
      this.zoom = Math.min(Math.max(Math.min(canvas.width / (sizes[0] || 1), canvas.height / (sizes[1] || 1)), 1), MOST_ZOOM);
      this.look(a.map((x, k) => (x + b[k]) / 2 - [canvas.width, canvas.height][k] / 2 / this.zoom));
    };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("pointerleave", () => { this.pointed.textContent = NOWHERE; });
  }

  drawBox(begun, event) {
    const { left, top, right, bottom } = this.canvas.getBoundingClientRect();
    const inside = (x, low, high) => Math.min(Math.max(x, low), high);
    const xs = [begun.clientX, event.clientX].map((x) => inside(x, left, right) - left).sort((a, b) => a - b), ys = [begun.clientY, event.clientY].map((y) => inside(y, top, bottom) - top).sort((a, b) => a - b);
    this.box.hidden = false;
    Object.assign(this.box.style, { left: `${xs[0]}px`, width: `${xs[1] - xs[0]}px`, top: `${ys[0]}px`, height: `${ys[1] - ys[0]}px` });
  }

  /** What is shown, outlines included, as a PNG. */
  save() { this.canvas.toBlob((blob) => download(blob, `${this.film.name.replace(/\.[^.]*$/, "")}-frame-${this.shown}.png`, "image/png"), "image/png"); }

  /** Show the frame nearest to a time. */
  show(t) {
    if (this.film.time_s) this.frame(nearest(this.film.time_s, t));
  }

  frame(index) {
    if (index === this.wanted) return;
    this.way = index >= this.wanted ? 1 : -1;
    this.wanted = index;
    if (this.grey(index)) this.draw(index);
    this.fetch();
  }

  /** Grey values of a frame that is here. */
  grey(index) {
    const chunk = this.kept.get(Math.floor(index / this.many));
    const first = (index % this.many) * this.bytes;
    return chunk && chunk.length >= first + this.bytes ? chunk.subarray(first, first + this.bytes) : null;
  }

  /** Ask for the chunk of the wanted frame first, then for the next in the direction one goes. */
  fetch() {
    const here = Math.floor(this.wanted / this.many), last = Math.floor((this.film.n_frames - 1) / this.many);
    for (const chunk of [here, here + this.way, here + 2 * this.way]) {
      if (this.asked.size >= AT_ONCE) return;
      if (chunk < 0 || chunk > last || this.kept.has(chunk) || this.asked.has(chunk)) continue;
      this.asked.add(chunk);
      this.load(chunk);
    }
  }

  async load(chunk) {
    try {
      const first = chunk * this.many, answer = await fetch(`${this.base}${first}-${this.many}?v=${this.film.version}`);
      if (!answer.ok) throw new Error((await answer.json()).error);
      this.kept.set(chunk, new Uint8Array(await answer.arrayBuffer()));
      const here = Math.floor(this.wanted / this.many);
      for (const old of this.kept.keys()) {
        if (this.kept.size <= this.most) break;
        if (Math.abs(old - here) > 2) this.kept.delete(old);
      }
      if (this.grey(this.wanted)) { if (this.shown !== this.wanted) this.draw(this.wanted); } else {
        // while scrubbing faster than frames come, the nearest that came is better than a standing picture
        const near = Math.min(Math.max(this.wanted, first), first + this.many - 1);
        if (Math.abs(near - this.wanted) < Math.abs(this.shown - this.wanted)) this.draw(near);
      }
    } catch (error) {
      if (this.closed) return;
      this.label.textContent = error.message;
      this.kept.set(chunk, new Uint8Array(0)); // not asked for again
    } finally {
      this.asked.delete(chunk);
    }
    if (!this.closed) this.fetch();
  }

  /** Draw a frame with its own outlines: picture and outlines are always of the same frame. */
  draw(index) {
    const grey = this.grey(index);
    if (!grey) return;
    const cells = new Uint32Array(this.image.data.buffer);
    for (let i = 0; i < grey.length; i++) cells[i] = 0xff000000 | grey[i] * 0x010101;
    this.plain.getContext("2d").putImageData(this.image, 0, 0);
    const pen = this.canvas.getContext("2d");
    pen.imageSmoothingEnabled = false;
    pen.setTransform(this.zoom, 0, 0, this.zoom, -this.zoom * this.corner[0], -this.zoom * this.corner[1]);
    pen.drawImage(this.plain, 0, 0, this.canvas.width, this.canvas.height);
    const lost = this.outlined.checked ? this.bodies.filter((body) => this.outline(pen, body, index)) : [];
    this.after?.(pen, index);
    pen.resetTransform();
    if (index !== this.shown) this.drawn++;
    this.shown = index;
    this.canvas.dataset.frame = index;
    const time = this.film.time_s ? `, ${(1000 * this.film.time_s[index]).toFixed(2)} ms` : "";
    this.told?.(index);
    this.label.textContent = `frame ${index} of ${this.film.n_frames}${time}${lost.map((body) => `, ${body.name} lost`).join("")}`;
  }

  /** Outline of a body where it was found; true where it was lost: then it is drawn where it was seen last. */
  outline(pen, body, index) {
    let row = body.row.get(index);
    if (row === undefined) return false;
    const lost = body.lost[row];
    while (row >= 0 && !Number.isFinite(body.turn[row])) row--;
    if (row < 0) return lost;
    const c = Math.cos(body.turn[row]), s = Math.sin(body.turn[row]), k = this.scale;
    pen.beginPath();
    for (const [x, y] of body.points) {
      pen.lineTo(k * (body.x[row] + c * x - s * y + 0.5), k * (body.y[row] + s * x + c * y + 0.5));
    }
    pen.closePath();
    for (const [color, width] of [["#000000", 3.5], [lost ? this.film.lost_color : body.color, 1.8]]) {
      pen.strokeStyle = color;
      pen.lineWidth = width / this.zoom;
      pen.stroke();
    }
    return lost;
  }

  close() {
    this.closed = true;
    this.kept.clear();
  }
}
