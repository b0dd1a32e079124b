/* Choice of the drawn trial, values under the pointer, and marks that follow the zoom.  Curves come from the attribute
   data-curves of the toolbar (see page.py); without this script the page shows one trial and its marks. */
for (const { home, bar, panels, after, make, current } of sessions) {
  const data = JSON.parse(bar.dataset.curves), LOST = -32768;
  const plain = (text) => text.replace(/-/g, "+").replace(/_/g, "/");
  const bytes = (text) => Uint8Array.from(atob(plain(text)), (c) => c.charCodeAt(0)).buffer;
  const time = new Float64Array(bytes(data.t)), n = time.length;
  for (const channel of Object.values(data.channels)) {
    channel.m = new Int16Array(bytes(channel.m));
    channel.p = channel.p.map((text) => new Int16Array(bytes(text)));
    if (channel.limit) channel.limit = new Int16Array(bytes(channel.limit));
  }
  const at = (values, scale, i, k) => values[i * n + k] === LOST ? NaN : values[i * n + k] * scale;
  const number = (x, digits = 3) => x.toFixed(digits).replace("-", "\u2212");
  let chosen = data.trials.indexOf(data.shown);

  const figures = [];
  for (const figure of home.querySelectorAll("figure[data-channel]")) {
    const svg = figure.querySelector("svg"), channel = data.channels[figure.dataset.channel];
    if (!channel) continue;
    const own = panels.filter((p) => p.svg === svg);
    const highest = Math.min(...own.map((p) => p.top));
    figures.push({ figure, svg, channel, highest, one: figure.dataset.shows === "one", own });
  }

  /* the curve of the chosen trial: path of a line, or of the area of width 2 half about it */
  const path = (p, y, half) => {
    const x = (k) => (p.left + (p.right - p.left) * (time[k] - p.x[0]) / (p.x[1] - p.x[0])).toFixed(2);
    const v = (value) => (p.bottom - (p.bottom - p.top) * (value - p.y[0]) / (p.y[1] - p.y[0])).toFixed(2);
    let d = "", pen = false, back = "";
    for (let k = 0; k < n; k++) {
      const value = y(k), h = half ? half(k) : 0;
      if (Number.isNaN(value) || Number.isNaN(h)) { if (back) d += back + "Z"; back = ""; pen = false; continue; }
      d += `${pen ? "L" : "M"}${x(k)} ${v(value + h)}`;
      if (half) back = `L${x(k)} ${v(value - h)}` + back;
      pen = true;
    }
    return d + (back ? back + "Z" : "");
  };
  const part = (figure, name) => document.getElementById(`${figure.id.replace("figure-", "")}-${name}`);
  const redraw = ({ channel, own, figure }) => {
    const measured = (k) => at(channel.m, channel.scale, chosen, k);
    const set = (p, name, y, half) => {
      const curve = part(figure, name);
      if (curve && document.getElementById(p.id).contains(curve)) curve.setAttribute("d", path(p, y, half));
    };
    for (const p of own) {
      set(p, "trial", measured);
      if (channel.limit) set(p, "limit", measured, (k) => at(channel.limit, channel.scale, 0, k));
      channel.p.forEach((values, m) => {
        set(p, `model${m}`, (k) => at(values, channel.scale, chosen, k));
        set(p, `difference${m}`, (k) => at(values, channel.scale, chosen, k) - measured(k));
      });
    }
    part(figure, "raw")?.setAttribute("d", "");
    const words = figure.querySelector(".of-trial"), trial = data.trials[chosen];
    if (words) words.textContent = data.words[figure.dataset.channel]?.[trial] ?? `Trial ${trial}.`;
  };

  /* marks: lines and letters, placed anew at every change of the axis */
  for (const { svg, one } of figures) if (one) svg.querySelectorAll(".marks").forEach((e) => e.remove());
  const marked = () => {
    const now = current();
    for (const { svg, own, highest } of one_only()) for (const p of own) {
      p.marks?.remove();
      p.marks = make("g", { class: "marks" });
      const { a, b } = now, first = p.top === highest;
      for (const [label, t, meaning] of data.marks[data.trials[chosen]]) {
        if (t < a || t > b) continue;
        const x = p.left + (p.right - p.left) * (t - a) / (b - a), named = /^[ABC]$/.test(label);
        const line = make("line", { x1: x, x2: x, y1: p.top, y2: p.bottom, stroke: named ? "#000" : "#777",
          "stroke-width": named ? 0.8 : 0.6, "stroke-dasharray": named ? "" : "1.5 1.5" });
        const title = make("title", {});
        title.textContent = `${meaning}, ${t.toFixed(4)} s`;
        line.append(title);
        p.marks.append(line);
        if (!named || !first) continue;
        const letter = make("text", { x, y: p.top - 3, "text-anchor": "middle", "font-size": 9, "font-weight": 700 });
        letter.textContent = label;
        p.marks.append(letter);
      }
      svg.append(p.marks);
    }
  };
  const one_only = () => figures.filter((f) => f.one);
  after.push(marked);
  marked();

  const choice = bar.querySelector("select");
  for (const trial of data.trials) choice.append(new Option(trial, trial, false, trial === data.shown));
  choice.addEventListener("change", () => {
    chosen = data.trials.indexOf(+choice.value);
    one_only().forEach(redraw);
    marked();
  });
  choice.closest("label").hidden = data.trials.length < 2;

  /* values under the pointer */
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.setAttribute("aria-hidden", "true");
  document.body.append(tip);
  const value = (values, scale, i, t) => {
    let low = 0, high = n - 1;
    while (high - low > 1) { const k = (low + high) >> 1; if (time[k] <= t) low = k; else high = k; }
    const share = (t - time[low]) / (time[high] - time[low] || 1);
    return at(values, scale, i, low) * (1 - share) + at(values, scale, i, high) * share;
  };
  for (const { svg, channel, own, one, figure } of figures) {
    const unit = figure.dataset.channel === "force" ? " N" : "\u00b0";
    svg.addEventListener("pointerleave", () => { tip.style.display = "none"; });
    svg.addEventListener("pointermove", (event) => {
      const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const p = own.find((q) => place.x >= q.left && place.x <= q.right && place.y >= q.top && place.y <= q.bottom);
      tip.style.display = p ? "block" : "none";
      if (!p) return;
      const { a, b } = current();
      const t = a + (b - a) * (place.x - p.left) / (p.right - p.left), lines = [`${t.toFixed(4)} s`];
      if (one) {
        const trial = value(channel.m, channel.scale, chosen, t);
        lines.push(`trial ${data.trials[chosen]}: ${number(trial)}${unit}`);
        channel.p.forEach((values, m) => {
          const model = value(values, channel.scale, chosen, t);
          lines.push(`${data.models[m]}: ${number(model)}${unit}, model \u2212 trial ${number(model - trial)}${unit}`);
        });
      } else {
        const all = data.trials.map((_, i) => value(channel.m, channel.scale, i, t)).filter((x) => !Number.isNaN(x));
        if (all.length) {
          lines.push(`mean of ${all.length}: ${number(all.reduce((x, y) => x + y, 0) / all.length)}${unit}`);
          lines.push(`from ${number(Math.min(...all))} to ${number(Math.max(...all))}${unit}`);
        }
      }
      tip.textContent = lines.join("\n");
      tip.style.left = `${Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8)}px`;
      tip.style.top = `${Math.min(event.clientY + 14, innerHeight - tip.offsetHeight - 8)}px`;
    });
  }
}
