// Key figures of a session's trials: those of the last one beside the control chart of all of them.
import { make } from "./elements.js";

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);

/** Figures of a trial as [key, title, unit, value]. */
function figuresOf(row) {
  const turned = Object.entries(row.turned_deg || {}).map(([body, deg]) => [`turned ${body}`, `${body[0].toUpperCase()}${body.slice(1)} turned`, "°", deg]);
  return [["peak", "Raw peak force", "N", row.raw_peak_force_n], ["rest", "Raw force before the blow", "N", row.raw_rest_force_n], ...turned];
}

const digits = (x) => (x === null || x === undefined ? "–" : Math.abs(x) >= 100 ? x.toFixed(1) : x.toFixed(3));

export function trialsPart() {
  const last = make("table", { id: "last" }), body = make("tbody"), head = make("tr");
  const chart = make("canvas", { class: "chart", width: 640, height: 170, role: "img", "aria-label": "Trials so far", hidden: true }), words = make("p", { class: "hint" });
  const choice = make("select", { onchange: () => draw() });
  const label = make("label", {}, "Chart of", choice);
  let rows = [];

  function set(figures) {
    rows = figures;
    const newest = rows[rows.length - 1];
    const kinds = newest ? figuresOf(newest) : [];
    const names = kinds.map(([key]) => key).join();
    if (choice.dataset.names !== names && kinds.length > 2) {
      const before = choice.value;
      choice.replaceChildren(...kinds.map(([key, title]) => make("option", { value: key }, title)));
      if (kinds.some(([key]) => key === before)) choice.value = before;
      choice.dataset.names = names;
    }
    head.replaceChildren(...["Trial", "Status", ...kinds.map(([, title, unit]) => `${title}, ${unit}`)].map((title, k) => make("th", { scope: "col", class: k > 1 ? "number" : null }, title)));
    body.replaceChildren(...[...rows].reverse().slice(0, 50).map((row) => {
      const values = new Map(figuresOf(row).map(([key, , , value]) => [key, value]));
      return make("tr", {}, make("th", { scope: "row" }, String(row.trial)),
        make("td", { class: row.status === "complete" ? "text" : "text problem" }, `${row.status}${row.rejected ? ", rejected" : ""}${row.reason ? `: ${row.reason}` : ""}`),
        ...kinds.map(([key]) => make("td", { class: "number" }, digits(values.get(key)))));
    }));
    draw();
  }

  const usable = (row) => row.status === "complete" && !row.rejected;

  /** Mean and standard deviation of the complete trials that count, but for one. */
  function compare(key, without = null) {
    const values = rows.filter((row) => usable(row) && row !== without).map((row) => figuresOf(row).find(([name]) => name === key)?.[3]).filter((x) => x !== null && x !== undefined);
    const mean = values.reduce((a, b) => a + b, 0) / values.length;
    return { n: values.length, mean, spread: Math.sqrt(values.reduce((a, b) => a + (b - mean) ** 2, 0) / Math.max(values.length - 1, 1)) };
  }

  function draw() {
    const newest = rows[rows.length - 1];
    if (!newest) { last.replaceChildren(); words.textContent = "No trial yet."; chart.hidden = label.hidden = true; return; }
    last.replaceChildren(make("caption", {}, `Trial ${newest.trial}, ${newest.status}`), make("tbody", {}, ...figuresOf(newest).map(([key, title, unit, value]) => {
      const { n, mean, spread } = compare(key, newest), away = n > 2 && spread > 0 && value !== null ? (value - mean) / spread : null;
      return make("tr", {}, make("th", { scope: "row" }, title), make("td", { class: "number" }, `${digits(value)} ${unit}`),
        make("td", { class: away !== null && Math.abs(away) > 2 ? "problem" : "hint" }, away === null ? "" : `${Math.abs(away).toFixed(1)} SD ${away >= 0 ? "above" : "below"} the others`));
    })));
    const key = choice.value || "peak", points = rows.map((row) => ({ row, kind: figuresOf(row).find(([name]) => name === key) })).filter(({ kind }) => kind && kind[3] !== null && kind[3] !== undefined);
    chart.hidden = label.hidden = points.length < 2;
    words.textContent = points.length < 2 ? "" : "Line: mean of the complete trials that count; dashed: two standard deviations. Square: rejected or stopped.";
    if (points.length < 2) return;
    const { n, mean, spread } = compare(key), unit = points[0].kind[2], pen = chart.getContext("2d");
    const all = points.map(({ kind }) => kind[3]).concat(n > 2 ? [mean - 2 * spread, mean + 2 * spread] : []);
    const low = Math.min(...all), high = Math.max(...all), wide = chart.width - 90, y = (v) => 140 - 120 * (v - low) / (high - low || 1), x = (i) => 80 + wide * (i + 0.5) / points.length;
    chart.setAttribute("aria-label", `${points[0].kind[1]} of ${points.length} trials, ${digits(low)} to ${digits(high)} ${unit}`);
    pen.clearRect(0, 0, chart.width, chart.height);
    pen.font = "13px system-ui, sans-serif";
    pen.fillStyle = style("--ink");
    pen.fillText(`${digits(high)} ${unit}`, 2, 24);
    pen.fillText(`${digits(low)} ${unit}`, 2, 144);
    pen.fillText(`trial ${points[0].row.trial}`, 80, 166);
    pen.textAlign = "right";
    pen.fillText(`${points[points.length - 1].row.trial}`, chart.width - 8, 166);
    pen.textAlign = "left";
    if (n > 2) {
      pen.strokeStyle = style("--soft");
      for (const [value, dash] of [[mean, []], [mean - 2 * spread, [5, 4]], [mean + 2 * spread, [5, 4]]]) { pen.setLineDash(dash); pen.beginPath(); pen.moveTo(80, y(value)); pen.lineTo(chart.width - 8, y(value)); pen.stroke(); }
      pen.setLineDash([]);
    }
    points.forEach(({ row, kind }, i) => {
      const newestToo = i === points.length - 1, size = newestToo ? 6 : 4;
      pen.beginPath();
      if (usable(row)) pen.arc(x(i), y(kind[3]), size, 0, 7); else pen.rect(x(i) - size, y(kind[3]) - size, 2 * size, 2 * size);
      pen.fillStyle = style(usable(row) ? "--mark" : "--warn");
      pen.fill();
      if (newestToo) { pen.strokeStyle = style("--ink"); pen.stroke(); }
    });
  }

  return {
    set,
    element: make("section", { "aria-label": "Trials" }, make("h2", {}, "Trials of this session"),
      make("div", { class: "beside" }, last, make("div", {}, label, chart, words)),
      make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Key figures of all trials" }, make("table", { id: "figures" }, make("thead", {}, head), body))),
  };
}
