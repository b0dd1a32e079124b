// A film's frames with the tracked outlines: only what is looked at is fetched, and a little ahead of it.
import { make } from "./elements.js";
import { nearest, unpack } from "./numbers.js";
import { at } from "./server.js";

const KEPT_BYTES = 64e6, CHUNK_BYTES = 1e6, CHUNK = 8, AT_ONCE = 3;

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
    this.outlined = make("input", { type: "checkbox", checked: true, onchange: () => this.draw(this.shown) });
    this.element = make("section", { class: "film", "aria-label": "Film" },
      make("div", { class: "head" }, make("span", { class: "title" }, film.name), this.label),
      this.canvas,
      make("div", { class: "row" }, make("label", {}, this.outlined, "outlines"), this.legend),
      film.note ? make("p", { class: "stale" }, film.note) : null);
  }

  /** The tracked outlines, now or after tracking again. */
  setBodies(bodies) {
    this.bodies = bodies.map((body) => ({ ...body, turn: unpack(body.turn), x: unpack(body.x), y: unpack(body.y), row: new Map(body.frame.map((f, i) => [f, i])) }));
    this.legend.replaceChildren(...this.bodies.map((body) => make("span", { class: "body" }, make("span", { class: "swatch", style: `background:${body.color}` }), body.name)));
  }

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
    pen.drawImage(this.plain, 0, 0, this.canvas.width, this.canvas.height);
    const lost = this.outlined.checked ? this.bodies.filter((body) => this.outline(pen, body, index)) : [];
    this.after?.(pen, index);
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
      pen.lineWidth = width;
      pen.stroke();
    }
    return lost;
  }

  close() {
    this.closed = true;
    this.kept.clear();
  }
}
