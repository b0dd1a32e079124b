/* Serious accessibility faults of the page, one line of text each (WCAG 2.2: 1.1.1, 1.3.1, 1.4.3, 2.1.1, 2.4.6, 3.1.1, 4.1.2). */
() => {
  const faults = [], say = (what, e) => faults.push(`${what}: ${e.id || e.textContent.trim().slice(0, 40) || e.tagName}`);
  const all = (selector) => [...document.querySelectorAll(selector)];
  const named = (e) => (e.getAttribute("aria-labelledby") || "").split(/\s+/).filter(Boolean)
    .map((id) => document.getElementById(id)?.textContent.trim()).filter(Boolean).join(" ")
    || e.getAttribute("aria-label")?.trim() || e.labels?.[0]?.textContent.trim() || e.getAttribute("alt")?.trim()
    || (e.matches("a, button, summary") ? e.textContent.trim() : "");
  if (!document.documentElement.lang) faults.push("no language");
  if (!document.title.trim()) faults.push("no title");
  if (all("main").length !== 1) faults.push("not one main");
  for (const e of all("img, svg")) if (!named(e) || (e.tagName === "svg" && e.getAttribute("role") !== "img")) say("image without text", e);
  for (const e of all("figure")) if (!e.querySelector("figcaption")?.textContent.trim()) say("figure without caption", e);
  for (const e of all("th")) if (!["col", "row", "colgroup", "rowgroup"].includes(e.getAttribute("scope"))) say("header without scope", e);
  for (const e of all("table")) if (!e.caption?.textContent.trim() || !e.querySelector("th")) say("table without caption or header", e);
  for (const e of all("a[href], button, input, summary, [role=region], form")) if (!named(e)) say("control or region without name", e);
  for (const e of all("[tabindex]")) if (e.tabIndex > 0) say("own order of tabs", e);
  let level = 0;
  for (const e of all("h1, h2, h3, h4, h5, h6")) {
    if (+e.tagName[1] > level + 1) say("heading skips a level", e);
    level = +e.tagName[1];
  }
  if (all("h1").length !== 1) faults.push("not one h1");
  const ids = all("[id]").map((e) => e.id);
  for (const id of new Set(ids.filter((x, i) => ids.indexOf(x) !== i))) faults.push("id twice: " + id);
  const colour = (text) => { const c = text.match(/[\d.]+/g)?.map(Number) ?? [0, 0, 0, 0]; return c.length < 4 ? [...c, 1] : c; };
  const over = (c, b) => [0, 1, 2].map((i) => c[3] * c[i] + (1 - c[3]) * b[i]);
  const light = (c) => [0.2126, 0.7152, 0.0722].reduce((sum, w, i) => {
    const v = c[i] / 255;
    return sum + w * (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  }, 0);
  const behind = (e) => e ? over(colour(getComputedStyle(e).backgroundColor), behind(e.parentElement)) : [255, 255, 255];
  const seen = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  let checked = 0;
  while (seen.nextNode()) {
    const e = seen.currentNode.parentElement;
    if (!seen.currentNode.data.trim() || e.closest("script, style, title, desc") || !e.getClientRects().length) continue;
    const style = getComputedStyle(e), back = behind(e);
    const ink = over(colour(e.closest("svg") ? style.fill : style.color), back);
    const [high, low] = [light(ink), light(back)].sort((x, y) => y - x);
    if ((high + 0.05) / (low + 0.05) < 4.5) say("contrast below 4.5", e);
    checked++;
  }
  return { faults, checked };
}
