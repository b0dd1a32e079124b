// The touch curve of an action, and what a technician's step does to the seven regulated lengths.
import { bokeh, style } from "./curves.js";
import { make } from "./elements.js";
import { unpack } from "./numbers.js";
import { ask } from "./server.js";

/** A button that presses the key slowly and draws force over dip; earlier curves stay, thin, to compare. */
export function touchPart(fetchTouch) {
  const place = make("div", { class: "touch" }), told = make("p", { class: "values", role: "status" });
  const button = make("button", { type: "button", onclick: measure }, "Press slowly");
  const shown = [];
  let stale = false;

  async function measure() {
    button.disabled = true;
    told.textContent = "pressing …";
    try {
      shown.push(await fetchTouch());
      if (shown.length > 3) shown.shift();
      stale = false;
      await draw();
    } catch (error) { told.textContent = error.message; } finally { button.disabled = false; }
  }

  async function draw() {
    const { Plotting, ColumnDataSource } = await bokeh();
    const plot = new Plotting.Figure({
      height: 220, sizing_mode: "stretch_width", tools: "", toolbar_location: null, background_fill_color: style("--back"),
      border_fill_color: style("--back"), outline_line_color: style("--line"),
    });
    plot.below[0].axis_label = "dip, mm";
    plot.left[0].axis_label = "force, N";
    for (const axis of [...plot.below, ...plot.left]) axis.major_label_text_color = axis.axis_label_text_color = style("--ink");
    shown.forEach((one, k) => {
      const now = k === shown.length - 1;
      for (const [branch, dash] of [["press", "solid"], ["release", "dashed"]]) {
        const source = new ColumnDataSource({ data: { x: Array.from(unpack(one[branch].dip_m), (x) => 1000 * x), y: unpack(one[branch].force_n) } });
        plot.line({ field: "x" }, { field: "y" }, { source, line_color: now ? style("--mark") : style("--soft"), line_width: now ? 2.2 : 1, line_dash: dash });
      }
    });
    const figure = make("figure", { class: "plot", role: "img", "aria-label": "Force over dip of a slow press and release" });
    place.replaceChildren(figure);
    await Plotting.show(plot, figure);
    const words = (one) => Object.entries(one.weights).map(([name, force]) => `${name} ${force.toFixed(3)} N`).join(", ");
    told.textContent = `${words(shown[shown.length - 1])}${shown.length > 1 ? `; before: ${words(shown[shown.length - 2])}` : ""}`;
  }

  return {
    element: make("section", { "aria-label": "Touch" }, make("h2", {}, "Touch"), make("div", { class: "row" }, button,
      make("span", { class: "hint" }, "solid: press, dashed: release; the two presses before stay thin")), told, place),
    /** The settings have changed since the last press. */
    old() { if (shown.length && !stale) { stale = true; told.textContent += " (before the last change)"; } },
  };
}

/** The seven lengths before and after one screw is turned. */
export function stepTable(place, address, target, screw) {
  const turn = make("select", { "aria-label": "Turn" }, ...[["0.0001", "+0.1 mm"], ["-0.0001", "−0.1 mm"], ["0.0005", "+0.5 mm"], ["-0.0005", "−0.5 mm"]].map(([value, text]) => make("option", { value }, text)));
  const result = make("div", { role: "status" });
  const mm = (x) => (x === null ? "–" : (1000 * x).toFixed(3));

  async function show() {
    result.replaceChildren("measuring …");
    try {
      const found = await ask(`${address}&${new URLSearchParams({ target, turn_m: turn.value })}`);
      result.replaceChildren(make("table", { id: "step" }, make("thead", {}, make("tr", {}, ...["Length, mm", "Wanted", "Before", "After", "Change"].map((title, k) => make("th", { scope: "col", class: k ? "number" : null }, title)))),
        make("tbody", {}, ...found.rows.map((row) => {
          const change = row.before_m === null || row.after_m === null ? null : row.after_m - row.before_m;
          return make("tr", { "aria-selected": String(row.target === target) }, make("th", { scope: "row" }, row.words, row.remark ? make("span", { class: "hint" }, ` ${row.remark}`) : null),
            ...[mm(row.wanted_m), mm(row.before_m), mm(row.after_m), change === null ? "–" : `${change > 0 ? "+" : ""}${mm(change)}`].map((text) => make("td", { class: "number" }, text)));
        }))));
    } catch (error) { result.replaceChildren(error.message); }
  }
  turn.addEventListener("change", show);
  place.replaceChildren(make("fieldset", {}, make("legend", {}, `What turning the ${screw} does`),
    make("label", {}, "Turn", turn), result, make("p", { class: "hint" }, "Measured as a technician does: at rest, in a slow press, in a medium blow. The sliders stay as they are.")));
  show();
}
