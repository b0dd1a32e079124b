// Curves over one time axis, drawn by BokehJS; a cursor over all of them, and the values under it.
import { make } from "./elements.js";
import { valueAt } from "./numbers.js";
import { download } from "./user.js";

const SCRIPTS = ["/drawing/bokeh.min.js", "/drawing/bokeh-api.min.js"];
const LEFT = 56, RIGHT = 12, HEAD_PX = 24;
const STEP = 1.25, LEAST_BOX_PX = 8; // of a turn of the wheel; a smaller box is a click
const DASH = { solid: [], dashed: [6, 4], dotted: [2, 3], dotdash: [2, 3, 6, 3] };
let loading = null;

/** BokehJS, fetched from this server when it is first needed. */
export function bokeh() {
  loading ??= SCRIPTS.reduce((before, src) => before.then(() => new Promise((done, failed) => {
    document.head.append(make("script", { src, onload: done, onerror: () => failed(new Error(`${src} cannot be read`)) }));
  })), Promise.resolve()).then(() => { window.Bokeh.set_log_level("error"); return window.Bokeh; });
  return loading;
}

/** From the least to the largest value, and a little more. Found here: Bokeh would index every point for it. */
function reach(lines) {
  let low = Infinity, high = -Infinity;
  for (const { value } of lines) for (const v of value) { if (v < low) low = v; if (v > high) high = v; }
  if (!(low < high)) { low = Number.isFinite(low) ? low - 1 : 0; high = low + 2; }
  return { start: low - 0.06 * (high - low), end: high + 0.06 * (high - low) };
}

/** A colour of the page's style sheet. */
export const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/**
 * A stack of plots. `panels`: [{title, unit, height, lines: [{label, time, value, color, dash, width}]}].
 * `pick(t)` is called when a time is pointed at. The wheel and a box drawn with Shift, or with the button, zoom; the
 * values under the pointer stand above each plot, beside the colour and the dash of their line.
 */
export class Curves {
  static async show(place, panels, { from, to, pick, name = "curves" }) {
    const { Plotting, Range1d, ColumnDataSource } = await bokeh();
    const self = new Curves();
    Object.assign(self, { place, views: [], from, to, pick, name });
    self.ranges = panels.map(() => new Range1d({ start: from, end: to, bounds: [from, to], min_interval: (to - from) / 5000 }));
    self.range = self.ranges[0]; // a model belongs to one document, so each plot has its own and all follow the one that moves
    self.cursor = make("div", { class: "cursor", "aria-hidden": "true" });
    self.pointed = make("div", { class: "cursor pointed", "aria-hidden": "true", hidden: true });
    self.box = make("div", { class: "box", "aria-hidden": "true", hidden: true });
    place.replaceChildren(self.tools(), self.cursor, self.pointed, self.box);
    place.classList.add("curves");
    for (const [k, panel] of panels.entries()) {
      const last = k === panels.length - 1;
      const plot = new Plotting.Figure({
        height: panel.height + (last ? 26 : 0), sizing_mode: "stretch_width", x_range: self.ranges[k], y_range: new Range1d(reach(panel.lines)), min_border_left: LEFT, min_border_right: RIGHT,
        min_border_top: 4, min_border_bottom: 4, tools: "", toolbar_location: null,
        background_fill_color: style("--back"), border_fill_color: style("--back"), outline_line_color: style("--line"), output_backend: "canvas",
      });
      for (const axis of [...plot.below, ...plot.left]) {
        axis.major_label_text_color = axis.axis_label_text_color = style("--ink");
        axis.axis_line_color = axis.major_tick_line_color = axis.minor_tick_line_color = style("--line");
        axis.axis_label_text_font_style = "normal";
      }
      for (const grid of plot.center) if ("grid_line_color" in grid) grid.grid_line_color = style("--shade");
      plot.left[0].ticker.desired_num_ticks = panel.height > 80 ? 5 : 3;
      if (last) plot.below[0].axis_label = "time, s"; else plot.below[0].visible = false;
      const sources = panel.lines.map((line) => {
        if (line.live) return null; // drawn over the plot: Bokeh would draw axes and labels again for each new value
        const source = new ColumnDataSource({ data: { x: line.time, y: line.value } });
        plot.line({ field: "x" }, { field: "y" }, { source, line_color: line.color, line_width: line.width ?? 1.5, line_dash: line.dash ?? "solid" });
        return source;
      });
      const values = make("span", { class: "values" }), told = panel.lines.map((line) => {
        const value = make("span");
        values.append(make("span", { class: "legend" }, make("span", { class: "line", style: `border-top: ${line.width ?? 1.5}px ${line.dash === "dotdash" ? "dashed" : line.dash ?? "solid"} ${line.color}` }), line.label ? `${line.label} ` : "", value));
        return value;
      });
      const figure = make("figure", { class: "plot", role: "img", "aria-label": `${panel.title} over time` });
      place.append(make("div", { class: "head" }, make("span", { class: "title" }, `${panel.title}, ${panel.unit}`), values), figure);
      const over = panel.lines.some((line) => line.live) ? make("canvas", { class: "over", "aria-hidden": "true" }) : null;
      const one = { view: await Plotting.show(plot, figure), panel, told, sources, figure, over };
      self.views.push(one);
      if (over) { figure.append(over); plot.y_range.change.connect(() => self.paint(one)); }
    }
    self.listen();
    for (const range of self.ranges) range.change.connect(() => self.follow(range));
    self.observer = new ResizeObserver(() => requestAnimationFrame(() => {
      self.at(self.time);
      for (const wait of [0, 120, 500]) setTimeout(() => self.views.forEach((one) => self.paint(one)), wait); // Bokeh finds new places some time later
    }));
    self.observer.observe(place);
    await self.settled();
    self.views.forEach((one) => self.paint(one));
    return self;
  }

  /** Until the plots have found their places on the page. */
  async settled() {
    for (let before = "", turns = 0; turns < 120; turns++) {
      await new Promise((next) => requestAnimationFrame(next));
      const now = this.area().join();
      if (now === before && this.area()[1] > 50) return;
      before = now;
    }
  }

  /** All plots show the same interval. */
  follow(moved) {
    if (this.moving) return;
    this.moving = true;
    for (const range of this.ranges) if (range !== moved) range.setv({ start: moved.start, end: moved.end });
    this.moving = false;
    this.at(this.time);
    this.views.forEach((one) => this.paint(one));
  }

  /** Draw the live lines of a plot, at the next picture of the screen. */
  paint(one) {
    if (!one.over || one.waiting) return;
    one.waiting = requestAnimationFrame(() => {
      one.waiting = 0;
      const { left, top, width, height } = one.view.frame.bbox, { x_range: x, y_range: y } = one.view.model, over = one.over;
      if (!(width > 0 && height > 0)) return;
      const ratio = Math.min(devicePixelRatio, 2), wide = Math.round(width * ratio), high = Math.round(height * ratio);
      if (over.width !== wide || over.height !== high) { over.width = wide; over.height = high; }
      Object.assign(over.style, { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` });
      const pen = over.getContext("2d"), sx = wide / (x.end - x.start), sy = high / (y.end - y.start);
      pen.clearRect(0, 0, wide, high);
      for (const line of one.panel.lines) {
        if (!line.live) continue;
        pen.strokeStyle = line.color;
        pen.lineWidth = (line.width ?? 1.5) * ratio;
        pen.lineJoin = "round";
        pen.beginPath();
        const n = line.time.length;
        let k = 0;
        while (k + 1 < n && line.time[k + 1] < x.start) k++;
        for (; k < n; k++) {
          pen.lineTo((line.time[k] - x.start) * sx, high - (line.value[k] - y.start) * sy);
          if (line.time[k] > x.end) break;
        }
        pen.stroke();
      }
    });
  }

  /** Left edge and width of the plotted area within the place, px; the same for all plots. */
  area() {
    const view = this.views[0].view, inner = view.frame.bbox, outer = this.views[0].figure.getBoundingClientRect();
    return [outer.left - this.place.getBoundingClientRect().left + inner.left, inner.width];
  }

  /** Buttons for what the pointer does, too. */
  tools() {
    this.boxes = make("button", { type: "button", "aria-pressed": "false", title: "or drag with Shift", onclick: () => this.boxes.setAttribute("aria-pressed", String(this.boxes.getAttribute("aria-pressed") !== "true")) }, "Box zoom");
    return make("div", { class: "row tools", role: "group", "aria-label": "Zoom and picture" }, this.boxes,
      make("button", { type: "button", "aria-label": "Zoom in", onclick: () => this.zoomAt(this.time ?? (this.range.start + this.range.end) / 2, STEP ** -2) }, "+"),
      make("button", { type: "button", "aria-label": "Zoom out", onclick: () => this.zoomAt(this.time ?? (this.range.start + this.range.end) / 2, STEP ** 2) }, "−"),
      make("button", { type: "button", onclick: () => this.whole() }, "Whole"),
      make("button", { type: "button", onclick: () => this.save() }, "Save picture"));
  }

  /** Share of the plotted width at which the pointer is, and the time there. */
  under(event) {
    const [left, width] = this.area();
    const share = (event.clientX - this.place.getBoundingClientRect().left - left) / width;
    return [share, this.range.start + share * (this.range.end - this.range.start)];
  }

  listen() {
    for (const one of this.views) {
      const { figure } = one;
      let begun = null, is_box = false;
      figure.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        begun = event;
        is_box = event.shiftKey || this.boxes.getAttribute("aria-pressed") === "true";
        figure.setPointerCapture(event.pointerId);
        const [share, t] = this.under(event);
        if (!is_box && share >= 0 && share <= 1) this.pick(t);
      });
      figure.addEventListener("pointermove", (event) => {
        const [share, t] = this.under(event);
        this.point(share >= 0 && share <= 1 ? t : null);
        if (begun && is_box) this.drawBox(begun, event, figure); else if (begun && share >= 0 && share <= 1) this.pick(t);
      });
      const end = (event) => {
        if (begun && is_box && event.type === "pointerup") this.zoomBox(one, begun, event);
        begun = null;
        this.box.hidden = true;
      };
      figure.addEventListener("pointerup", end);
      figure.addEventListener("pointercancel", end);
      figure.addEventListener("pointerleave", () => { if (!begun) this.point(null); });
      figure.addEventListener("wheel", (event) => {
        const [share, t] = this.under(event), is_out = event.deltaY > 0;
        if (event.ctrlKey || share < 0 || share > 1 || (is_out && this.range.start <= this.from && this.range.end >= this.to)) return; // the page scrolls
        event.preventDefault();
        this.zoomAt(t, is_out ? STEP : 1 / STEP);
      }, { passive: false });
    }
  }

  drawBox(begun, event, figure) {
    const place = this.place.getBoundingClientRect(), plot = figure.getBoundingClientRect(), inside = (y) => Math.min(Math.max(y, plot.top), plot.bottom);
    const [x0, x1] = [begun.clientX, event.clientX].sort((a, b) => a - b), [y0, y1] = [inside(begun.clientY), inside(event.clientY)].sort((a, b) => a - b);
    this.box.hidden = false;
    Object.assign(this.box.style, { left: `${x0 - place.left}px`, width: `${x1 - x0}px`, top: `${y0 - place.top}px`, height: `${y1 - y0}px` });
  }

  /** Show what lies in a box: its times in all plots, its values in the plot it was drawn in. */
  zoomBox(one, begun, event) {
    const { top, height } = one.view.frame.bbox, { start, end } = one.view.model.y_range, above = one.figure.getBoundingClientRect().top + top;
    const value = (y) => end - (Math.min(Math.max(y - above, 0), height) / height) * (end - start);
    const times = [this.under(begun)[1], this.under(event)[1]].sort((a, b) => a - b), values = [value(begun.clientY), value(event.clientY)].sort((a, b) => a - b);
    if (Math.abs(event.clientX - begun.clientX) >= LEAST_BOX_PX) this.zoom(...times);
    if (Math.abs(event.clientY - begun.clientY) >= LEAST_BOX_PX) one.view.model.y_range.setv({ start: values[0], end: values[1] });
  }

  /** So many times as long an interval, in which a time keeps its place. */
  zoomAt(t, times) {
    const width = Math.max((this.range.end - this.range.start) * times, (this.to - this.from) / 5000);
    const start = Math.max(t - (t - this.range.start) / (this.range.end - this.range.start) * width, this.from);
    this.zoom(start, start + width);
  }

  /** The values under the pointer; those of the cursor where it points at no time. */
  point(t) {
    this.hovered = t;
    this.pointed.hidden = t === null;
    if (t !== null) {
      const [left, width] = this.area();
      this.pointed.style.transform = `translateX(${left + (t - this.range.start) / (this.range.end - this.range.start) * width}px)`;
    }
    this.at(this.time);
  }

  /** All plots under one another as a PNG, each with its legend. */
  async save() {
    const parts = this.views.map((one) => ({ ...one, canvas: one.view.export("png", true).canvas, ratio: 1 }));
    for (const part of parts) part.ratio = part.canvas.width / part.view.bbox.width;
    const ratio = parts[0].ratio, head = Math.round(HEAD_PX * ratio);
    const width = Math.max(...parts.map(({ canvas }) => canvas.width)), height = parts.reduce((sum, { canvas }) => sum + canvas.height + head, 0);
    const picture = make("canvas", { width, height }), pen = picture.getContext("2d");
    pen.fillStyle = style("--back");
    pen.fillRect(0, 0, width, height);
    pen.font = `${13 * ratio}px system-ui, sans-serif`;
    let top = 0;
    for (const { panel, canvas, view, over } of parts) {
      let x = LEFT * ratio;
      const write = (text) => { pen.fillStyle = style("--ink"); pen.fillText(text, x, top + 0.7 * head); x += pen.measureText(text).width + 12 * ratio; };
      write(`${panel.title}, ${panel.unit}`);
      for (const line of panel.lines.filter(({ label }) => label)) {
        pen.strokeStyle = line.color;
        pen.lineWidth = (line.width ?? 1.5) * ratio;
        pen.setLineDash((DASH[line.dash ?? "solid"] ?? []).map((d) => d * ratio));
        pen.beginPath();
        pen.moveTo(x, top + 0.55 * head);
        pen.lineTo(x + 22 * ratio, top + 0.55 * head);
        pen.stroke();
        x += 28 * ratio;
        write(line.label);
      }
      pen.drawImage(canvas, 0, top + head);
      const { left, top: inner, width: wide, height: high } = view.frame.bbox;
      if (over) pen.drawImage(over, left * ratio, top + head + inner * ratio, wide * ratio, high * ratio);
      top += head + canvas.height;
    }
    const blob = await new Promise((done) => { picture.toBlob(done, "image/png"); });
    download(blob, `${this.name}.png`, "image/png");
  }

  /** Put the cursor at a time and say the values there. */
  at(t) {
    this.time = t;
    if (t === undefined || !this.views.length) return;
    const [left, width] = this.area();
    const share = (t - this.range.start) / (this.range.end - this.range.start);
    this.cursor.hidden = !(share >= 0 && share <= 1);
    this.cursor.style.transform = `translateX(${left + share * width}px)`;
    for (const { panel, told } of this.views) {
      panel.lines.forEach((line, i) => {
        const value = valueAt(line.time, line.value, this.hovered ?? t);
        told[i].textContent = Number.isFinite(value) ? value.toFixed(panel.digits ?? 2).replace("-", "−") : "–";
      });
    }
  }

  /** New {time, value} of one line of a plot. */
  replace(k, i, line) {
    const one = this.views[k];
    Object.assign(one.panel.lines[i], line);
    if (one.sources[i]) one.sources[i].data = { x: one.panel.lines[i].time, y: line.value }; else this.paint(one);
    const range = one.view.model.y_range, wanted = reach(one.panel.lines), share = 0.1 * (wanted.end - wanted.start);
    const inside = wanted.start >= range.start - 1e-12 && wanted.end <= range.end + 1e-12;
    if (!inside || range.end - range.start > wanted.end - wanted.start + 4 * share) range.setv(wanted);
  }

  zoom(from, to) { this.range.setv({ start: Math.max(from, this.from), end: Math.min(to, this.to) }); }

  whole() {
    this.range.setv({ start: this.from, end: this.to });
    for (const one of this.views) one.view.model.y_range.setv(reach(one.panel.lines));
  }

  close() { this.observer?.disconnect(); }
}
