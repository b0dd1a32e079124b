/* Values under the pointer in figures that carry their own, attribute data-pointed (see figures/pointed.py). */
for (const { home, panels, current } of sessions) {
  const tip = document.querySelector(".tip");
  const nearest = (x, t) => {
    let low = 0, high = x.length - 1;
    while (high - low > 1) { const k = (low + high) >> 1; if (x[k] <= t) low = k; else high = k; }
    return t - x[low] <= x[high] - t ? low : high;
  };
  for (const svg of home.querySelectorAll("svg[data-pointed]")) {
    const every = JSON.parse(svg.dataset.pointed);
    svg.addEventListener("pointerleave", () => { tip.style.display = "none"; });
    svg.addEventListener("pointermove", (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const inside = (p) => at.x >= p.left && at.x <= p.right && at.y >= p.top && at.y <= p.bottom;
      const own = every.find((one) => one.x.length && one.panels.some(inside));
      tip.style.display = own ? "block" : "none";
      if (!own) return;
      const p = own.panels.find(inside), now = current();
      const [a, b] = panels.some((q) => q.id === p.id) ? [now.a, now.b] : p.x;
      const k = nearest(own.x, a + (b - a) * (at.x - p.left) / (p.right - p.left));
      const text = (v, digits) => v.toFixed(digits).replace("-", "\u2212");
      const lines = [own.head.replace("{}", text(own.x[k], own.digits))];
      for (const { name, unit, digits, y } of own.lines)
        lines.push(`${name}: ${y[k] === null ? "\u2013" : text(y[k], digits) + unit}`);
      tip.textContent = lines.join("\n");
      tip.style.left = `${Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8)}px`;
      tip.style.top = `${Math.min(event.clientY + 14, innerHeight - tip.offsetHeight - 8)}px`;
    });
  }
}
