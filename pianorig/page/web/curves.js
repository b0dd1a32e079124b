// Curves over one time axis, drawn by BokehJS; a cursor over all of them, and the values under it.
import { make } from "./elements.js";
import { valueAt } from "./numbers.js";

const SCRIPTS = ["/drawing/bokeh.min.js", "/drawing/bokeh-api.min.js"];
const LEFT = 56, RIGHT = 12;
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
 * `pick(t)` is called when a time is pointed at.
 */
export class Curves {
  static async show(place, panels, { from, to, pick }) {
    const { Plotting, Range1d, ColumnDataSource } = await bokeh();
    const self = new Curves();
    Object.assign(self, { place, views: [], from, to, pick });
    self.ranges = panels.map(() => new Range1d({ start: from, end: to, bounds: [from, to], min_interval: (to - from) / 5000 }));
    self.range = self.ranges[0]; // a model belongs to one document, so each plot has its own and all follow the one that moves
    self.cursor = make("div", { class: "cursor", "aria-hidden": "true" });
    place.replaceChildren(self.cursor);
    place.classList.add("curves");
    for (const [k, panel] of panels.entries()) {
      const last = k === panels.length - 1;
      const plot = new Plotting.Figure({
        height: panel.height + (last ? 26 : 0), sizing_mode: "stretch_width", x_range: self.ranges[k], y_range: new Range1d(reach(panel.lines)), min_border_left: LEFT, min_border_right: RIGHT,
        min_border_top: 4, min_border_bottom: 4, tools: "xpan,xwheel_zoom,xbox_zoom,reset", toolbar_location: null,
        background_fill_color: style("--back"), border_fill_color: style("--back"), outline_line_color: style("--line"), output_backend: "canvas",
      });
      plot.toolbar.active_drag = null;
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
      const values = make("span", { class: "values" });
      const figure = make("figure", { class: "plot", role: "img", "aria-label": `${panel.title} over time` });
      place.append(make("div", { class: "head" }, make("span", { class: "title" }, `${panel.title}, ${panel.unit}`), values), figure);
      const over = panel.lines.some((line) => line.live) ? make("canvas", { class: "over", "aria-hidden": "true" }) : null;
      const one = { view: await Plotting.show(plot, figure), panel, values, sources, figure, over };
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

  listen() {
    let held = false;
    const point = (event) => {
      const [left, width] = this.area();
      const share = (event.clientX - this.place.getBoundingClientRect().left - left) / width;
      if (share >= 0 && share <= 1) this.pick(this.range.start + share * (this.range.end - this.range.start));
    };
    for (const { figure } of this.views) {
      figure.addEventListener("pointerdown", (event) => { if (event.button === 0) { held = true; figure.setPointerCapture(event.pointerId); point(event); } });
      figure.addEventListener("pointermove", (event) => { if (held) point(event); });
      figure.addEventListener("pointerup", () => { held = false; });
      figure.addEventListener("pointercancel", () => { held = false; });
    }
  }

  /** Put the cursor at a time and say the values there. */
  at(t) {
    this.time = t;
    if (t === undefined || !this.views.length) return;
    const [left, width] = this.area();
    const share = (t - this.range.start) / (this.range.end - this.range.start);
    this.cursor.hidden = !(share >= 0 && share <= 1);
    this.cursor.style.transform = `translateX(${left + share * width}px)`;
    for (const { panel, values } of this.views) {
      values.textContent = panel.lines.map((line) => {
        const value = valueAt(line.time, line.value, t);
        return `${line.label} ${Number.isFinite(value) ? value.toFixed(panel.digits ?? 2) : "–"}`;
      }).join("   ");
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

  whole() { this.range.setv({ start: this.from, end: this.to }); }

  close() { this.observer?.disconnect(); }
}
