// Points and lines to follow: clicked on the still frames, saved, followed; on other frames where they were found.
import { make } from "./elements.js";
import { jobButton } from "./jobs.js";
import { unpack } from "./numbers.js";
import { ask, LOOK_ONLY, mayWrite } from "./server.js";
import { say } from "./user.js";

const COLOR = "#FFD400", LOST = "#ff3b30", REACH_PX = 9, WANTED = { point: 1, line: 2 }, SIZE = { point: 10, line: 16 };
const WORDS = { point: "radius", line: "width" };

/** `reload()` reads the film's page again; `rate()` is the frame rate that was typed, or undefined. */
export function marksPart({ panel, known, base, kept, ended, reload, rate, editor }) {
  let marks = JSON.parse(sessionStorage.getItem(kept) || "null") || structuredClone(known.marks), found = unpacked(known.found), chosen = -1, held = -1;
  const before = [], rows = make("div"), told = make("p", { class: "values", role: "status" });
  const undo = make("button", { type: "button", onclick: takeBack }, "Undo mark");
  const canvas = panel.canvas, drawOutlines = panel.after;

  function unpacked(all) {
    return new Map(Object.entries(all).map(([name, one]) => [name, Object.fromEntries(Object.entries(one).map(([key, value]) => [key, value.f32 === undefined ? value : unpack(value)]))]));
  }

  function keep() { before.push(JSON.stringify(marks)); if (before.length > 200) before.shift(); }

  function takeBack() {
    if (!before.length) return;
    marks = JSON.parse(before.pop());
    chosen = Math.min(chosen, marks.length - 1);
    changed();
  }

  function changed() { sessionStorage.setItem(kept, JSON.stringify(marks)); list(); panel.draw(panel.shown); }

  function add(kind) {
    keep();
    let n = marks.length + 1;
    while (marks.some((mark) => mark.name === `${kind}${n}`)) n++;
    marks.push({ kind, name: `${kind}${n}`, points: [], size: SIZE[kind] });
    choose(marks.length - 1);
    changed();
  }

  function choose(i) { chosen = i; list(); panel.draw(panel.shown); canvas.focus(); }

  /** The outlines' editor has the pointer, unless a mark is chosen. */
  function down(event) {
    if (chosen < 0 || event.button !== 0) return;
    event.stopImmediatePropagation();
    canvas.focus();
    if (panel.shown > 0) { say("points and lines are placed on the first frame: go to the still frames"); return; }
    canvas.setPointerCapture(event.pointerId);
    const [x, y] = editor.where(event), mark = marks[chosen], reach = REACH_PX * panel.film.width / canvas.getBoundingClientRect().width;
    keep();
    held = mark.points.findIndex(([px, py]) => Math.hypot(px - x, py - y) < reach);
    if (held < 0 && mark.points.length < WANTED[mark.kind]) { mark.points.push([x, y]); held = mark.points.length - 1; }
    if (held < 0) { held = WANTED[mark.kind] - 1; mark.points[held] = [x, y]; }
    changed();
  }

  function move(event) {
    if (held < 0 || chosen < 0) return;
    event.stopImmediatePropagation();
    marks[chosen].points[held] = editor.where(event);
    changed();
  }

  function keys(event) {
    if (document.activeElement !== canvas || chosen < 0 || event.altKey || event.metaKey || event.key === "z") return;
    const by = event.shiftKey ? 0.1 : event.ctrlKey ? 10 : 1, steps = { ArrowLeft: [-by, 0], ArrowRight: [by, 0], ArrowUp: [0, -by], ArrowDown: [0, by] };
    const mark = marks[chosen];
    if (event.key === "Escape") { chosen = -1; list(); panel.draw(panel.shown); return; }
    if (event.key === "Enter" && mark.points.length < WANTED[mark.kind]) {
      event.preventDefault();
      event.stopImmediatePropagation();
      keep();
      mark.points.push([Math.round(panel.film.width / 2) + 40 * mark.points.length, Math.round(panel.film.height / 2)]);
      changed();
      return;
    }
    if (!(event.key in steps) || !mark.points.length) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    keep();
    const k = mark.points.length - 1, [dx, dy] = steps[event.key], tenth = (x) => Math.round(10 * x) / 10;
    mark.points[k] = [tenth(mark.points[k][0] + dx), tenth(mark.points[k][1] + dy)];
    changed();
  }

  const up = () => { held = -1; };
  canvas.addEventListener("pointerdown", down, true);
  canvas.addEventListener("pointermove", move, true);
  canvas.addEventListener("pointerup", up, true);
  document.addEventListener("keydown", keys, true);

  function list() {
    rows.replaceChildren(...marks.map((mark, i) => {
      const name = make("input", { value: mark.name, size: 10, "aria-label": `Name of mark ${i + 1}`, onchange: () => { keep(); mark.name = name.value.trim(); changed(); } });
      const size = make("input", { type: "number", min: 3, step: "any", value: mark.size, "aria-label": `${WORDS[mark.kind]} of ${mark.name}, px`, onchange: () => { keep(); mark.size = Number(size.value); changed(); } });
      const lacks = WANTED[mark.kind] - mark.points.length;
      return make("div", { class: "row mark", "aria-current": i === chosen ? "true" : null },
        make("button", { type: "button", "aria-pressed": String(i === chosen), onclick: () => choose(i === chosen ? -1 : i) }, lacks ? `${mark.kind}: click ${lacks === 2 ? "two places" : lacks === 1 && mark.kind === "line" ? "its other end" : "it"}` : mark.kind),
        name, make("label", {}, WORDS[mark.kind], size, "px"), make("button", { type: "button", "aria-label": `Delete ${mark.name}`, onclick: () => { keep(); marks.splice(i, 1); chosen = -1; changed(); } }, "✕"));
    }));
    undo.disabled = !before.length;
  }

  /** Where a followed mark is in a frame: its places, or null. */
  function placesOf(mark, index) {
    const one = found.get(mark.name), row = one ? one.frame.indexOf(index) : -1;
    const asFollowed = known.marks.find(({ name }) => name === mark.name); // what was found of a mark drawn elsewhere is not of this one
    if (row < 0 || JSON.stringify(asFollowed?.points) !== JSON.stringify(mark.points)) return null;
    if (mark.kind === "point") return { lost: one.lost[row] || !one.x_px, places: one.x_px ? [[one.x_px[row], one.y_px[row]]] : [], words: one.x_px ? `${mark.name} x ${one.x_px[row].toFixed(2)} ± ${one.u_x_px[row].toFixed(2)}, y ${one.y_px[row].toFixed(2)} ± ${one.u_y_px[row].toFixed(2)} px` : "" };
    if (!one.offset_px) return null;
    const [[ax, ay], [bx, by]] = mark.points, long = Math.hypot(bx - ax, by - ay), off = one.offset_px[row], nx = (by - ay) / long, ny = -(bx - ax) / long;
    return { lost: one.lost[row], places: [[ax + off * nx, ay + off * ny], [bx + off * nx, by + off * ny]], words: `${mark.name} ${off >= 0 ? "+" : ""}${off.toFixed(2)} ± ${one.u_offset_px[row].toFixed(2)} px to its left` };
  }

  panel.after = (pen, index) => {
    drawOutlines?.(pen, index);
    const k = panel.scale, to = ([x, y]) => [k * (x + 0.5), k * (y + 0.5)], words = [];
    for (const [i, mark] of marks.entries()) {
      const where = index > 0 ? placesOf(mark, index) : { places: mark.points, lost: false, words: "" };
      if (!where || !where.places.length) continue;
      words.push(where.lost ? `${mark.name} lost` : where.words);
      const trace = () => {
        pen.beginPath();
        if (mark.kind === "point") { const [x, y] = to(where.places[0]); pen.arc(x, y, k * mark.size, 0, 7); pen.moveTo(x - 4, y); pen.lineTo(x + 4, y); pen.moveTo(x, y - 4); pen.lineTo(x, y + 4); } else for (const place of where.places) { pen.lineTo(...to(place)); const [x, y] = to(place); pen.moveTo(x + 4, y); pen.arc(x, y, 4, 0, 7); pen.moveTo(x, y); }
      };
      for (const [shade, broad] of [["#000000", 3.4], [where.lost ? LOST : COLOR, i === chosen ? 2.2 : 1.4]]) { pen.strokeStyle = shade; pen.lineWidth = broad; trace(); pen.stroke(); }
      if (mark.kind === "line" && where.places.length === 2) { pen.strokeStyle = COLOR; pen.globalAlpha = 0.22; pen.lineWidth = k * mark.size; pen.beginPath(); where.places.forEach((place) => pen.lineTo(...to(place))); pen.stroke(); pen.globalAlpha = 1; }
    }
    const text = words.filter(Boolean).join("; ");
    if (told.textContent !== text) told.textContent = text;
  };

  async function save() {
    try {
      const done = await ask(`${base}/marks`, { method: "POST", body: { marks } });
      sessionStorage.removeItem(kept);
      say(`saved: ${done.marks.join(", ")} in ${done.file}`);
      return true;
    } catch (error) { say(error.message); return false; }
  }

  const follow = jobButton({
    kept: `job ${kept}`, title: "Follow", disabled: !mayWrite(), hint: LOOK_ONLY, ended,
    begin: async () => {
      if (!(await save())) throw new Error("points and lines are not saved, so nothing is followed");
      return ask(`${base}/follow`, { method: "POST", body: rate() ? { frame_rate_hz: rate() } : {} });
    },
    done: async () => { say("followed"); await reload(); },
  });
  list();
  return {
    element: make("fieldset", {}, make("legend", {}, "Points and lines"),
      make("div", { class: "row" }, make("button", { type: "button", onclick: () => add("point") }, "New point"), make("button", { type: "button", onclick: () => add("line") }, "New line"), undo,
        make("button", { type: "button", disabled: !mayWrite(), title: mayWrite() ? null : LOOK_ONLY, onclick: save }, "Save marks")),
      known.problem ? make("p", { class: "notice" }, known.problem) : "", rows, follow, told,
      make("p", { class: "hint" }, `A point: click its middle; its disc should hold the whole spot. A line: click two places on it; it is followed across itself. While one is chosen, clicks, arrow keys and Enter (sets it without a pointer) are its own; Escape gives them back to the outlines. In ${known.file}.`)),
    /** What following has found, read again. */
    set(now) { known = now; found = unpacked(now.found); panel.draw(panel.shown); },
    /** An outline was chosen, so no mark is. */
    release() { if (chosen >= 0) { chosen = -1; list(); } },
    close() { document.removeEventListener("keydown", keys, true); canvas.removeEventListener("pointerdown", down, true); canvas.removeEventListener("pointermove", move, true); },
  };
}
