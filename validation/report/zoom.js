/* One time axis for all overlays of a session: the panels named in each figure's data-panels show the same stretch of
   time.  Curves are moved and stretched as drawn (stroke widths stay); without this script the page shows the whole
   window. */
"use strict";
const sessions = [];
for (const home of document.querySelectorAll(".session")) {
  const bar = home.querySelector("form.zoom");
  const SVG = document.querySelector("svg").namespaceURI;
  const { from, to } = bar.elements, said = bar.querySelector("output");
  const whole = { a: +from.min, b: +from.max };
  const LEAST = 1e-3;
  let now = { ...whole };

  const make = (name, attributes) => {
    const e = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) e.setAttribute(key, value);
    return e;
  };

  const panels = [], after = [];
  for (const svg of home.querySelectorAll("svg[data-panels]")) {
    for (const p of JSON.parse(svg.dataset.panels)) {
      const axes = document.getElementById(p.id), own = axes.querySelector(".x-ticks"), ticks = make("g", { class: "zoom-ticks" });
      own.after(ticks);
      panels.push({ ...p, svg, moving: axes.querySelector(".moving"), ticks, own });
    }
  }

  const ticksOf = (a, b) => {
    const rough = (b - a) / 6, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= rough);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const out = [];
    for (let k = Math.ceil(a / step - 1e-9); k * step <= b + 1e-9; k++) out.push([k * step, (k * step).toFixed(digits)]);
    return out;
  };

  const show = (a, b) => {
    const width = Math.min(Math.max(b - a, LEAST), whole.b - whole.a);
    a = Math.min(Math.max(a, whole.a), whole.b - width);
    now = { a, b: a + width };
    const all = width > (whole.b - whole.a) * (1 - 1e-9);
    for (const p of panels) {
      const at = (t) => p.left + (p.right - p.left) * (t - now.a) / width;
      const k = (whole.b - whole.a) / width;
      p.moving.setAttribute("transform", all ? "" : `translate(${at(whole.a) - k * p.left} 0) scale(${k} 1)`);
      p.own.style.display = all ? "" : "none";
      p.ticks.replaceChildren();
      if (all) continue;
      for (const [t, text] of ticksOf(now.a, now.b)) {
        const x = at(t);
        p.ticks.append(make("line", { x1: x, x2: x, y1: p.top, y2: p.bottom, stroke: "#ddd", "stroke-width": 0.6 }));
        p.ticks.append(make("line", { x1: x, x2: x, y1: p.bottom, y2: p.bottom + 3.5, stroke: "#000" }));
        if (!p.labelled) continue;
        const label = make("text", { x, y: p.bottom + 14, "text-anchor": "middle", "font-size": 9 });
        label.textContent = text;
        p.ticks.append(label);
      }
    }
    from.value = now.a.toFixed(4);
    to.value = now.b.toFixed(4);
    for (const act of after) act();
    said.textContent = all ? "Whole evaluation window." : `${now.a.toFixed(4)} s to ${now.b.toFixed(4)} s.`;
  };

  const scaled = (factor) => {
    const middle = (now.a + now.b) / 2, half = factor * (now.b - now.a) / 2;
    show(middle - half, middle + half);
  };
  const moved = (share) => show(now.a + share * (now.b - now.a), now.b + share * (now.b - now.a));
  const deeds = {
    in: () => scaled(0.5), out: () => scaled(2), left: () => moved(-0.25), right: () => moved(0.25),
    whole: () => show(whole.a, whole.b),
    impact: () => show(+bar.dataset.impact - 0.02, +bar.dataset.impact + 0.03),
  };
  bar.addEventListener("click", (event) => deeds[event.target.dataset.zoom]?.());
  bar.addEventListener("submit", (event) => {
    event.preventDefault();
    const a = parseFloat(from.value), b = parseFloat(to.value);
    if (b - a >= LEAST) show(a, b);
    else said.textContent = "The end must lie at least 0.001 s after the start.";
  });

  /* with a mouse: draw over a stretch of a panel to see it; a double click shows everything */
  for (const svg of home.querySelectorAll("svg[data-panels]")) {
    let start = null;
    const place = (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const p = panels.find((q) => svg.contains(q.ticks) && at.x >= q.left && at.x <= q.right && at.y >= q.top && at.y <= q.bottom);
      return p ? now.a + (now.b - now.a) * (at.x - p.left) / (p.right - p.left) : null;
    };
    svg.addEventListener("pointerdown", (event) => {
      start = event.button === 0 && event.pointerType !== "touch" ? place(event) : null;  // a finger scrolls
    });
    svg.addEventListener("pointerup", (event) => {
      const end = place(event);
      if (start !== null && end !== null && Math.abs(end - start) > 0.01 * (now.b - now.a))
        show(Math.min(start, end), Math.max(start, end));
      start = null;
    });
    svg.addEventListener("dblclick", () => show(whole.a, whole.b));
  }
  bar.hidden = false;
  sessions.push({ home, bar, panels, after, make, current: () => now });
}
