// The action to try out: screws and parameters as sliders, a blow that follows them, the touch, a technician's step, a file.
import { address, link } from "./address.js";
import { Curves } from "./curves.js";
import { Drawing } from "./drawing.js";
import { make } from "./elements.js";
import { unpack } from "./numbers.js";
import { KEYS, Player } from "./player.js";
import { ask, at } from "./server.js";
import { stepTable, touchPart } from "./touch.js";
import { download, say } from "./user.js";

const MOST_UNDONE = 200, QUIET_MS = 80, LONGEST_MS = 400, MOST_BEFORE = 10;
const WHOLE = "whole", SAME = "this scene", OWN = "of your own";
/** Units of the sliders, and how many of them one of the model's is. */
const SHOWN = { m: ["mm", 1e3], "N*m": ["mN m", 1e3], kg: ["g", 1e3], "kg*m^2": ["g cm²", 1e7], "1": ["", 1], "N/m": ["N/mm", 1e-3], rad: ["mrad", 1e3] };
const EXAMPLE = 'effects = ["balance_rail"]\n\n[contact02]\nlaw = "hysteresis"\nhysteresis.beta = 0.3\n';

export async function showAction(main, values) {
  const { actions, blows, scenes } = await ask("/api/actions");
  const name = values.get("action") || actions[0], blow = values.get("blow") || blows[0], scene = values.get("scene") || WHOLE;
  const beside = scene !== WHOLE && values.get("beside") === SAME ? scene : WHOLE;
  const givenAs = scene !== WHOLE && beside === WHOLE ? WHOLE : "as given";
  const go = (key, value) => { const now = address().values; now.set(key, value); if (key === "action") now.delete("set"); location.hash = link("action", now); };
  const choose = (title, options, value, key) => {
    const select = make("select", { id: `choose-${key}`, onchange: () => { if (select.value === OWN) own.open = true; else go(key, select.value); } },
      ...options.map((text) => make("option", { value: text }, text)));
    select.value = value;
    return make("label", {}, title, select);
  };
  const own = ownScene(scene in scenes ? "" : scene, (text) => go("scene", text));
  const choices = make("div", { class: "row" }, choose("Action", actions, name, "action"), choose("Scene", [...Object.keys(scenes), OWN], scene in scenes ? scene : OWN, "scene"),
    choose("Blow", blows, blow, "blow"), scene === WHOLE ? null : choose("Beside", [WHOLE, SAME], beside === WHOLE ? WHOLE : SAME, "beside"));
  main.append(choices, own);
  if (scenes[scene]) { main.append(make("p", { class: "notice", role: "alert" }, scenes[scene])); return null; }
  const facts = await ask(`/api/action/${at(name)}?${new URLSearchParams({ scene })}`);
  const given = new Map(facts.parameters.map((one) => [one.path, one]));
  const screws = new Map(facts.screws.map((one) => [one.path, one]));
  const set = new Map(values.getAll("set").map((text) => text.split("=")).filter(([path, value]) => given.has(path) && Number.isFinite(Number(value))).map(([path, value]) => [path, Number(value)]));
  const rows = new Map(), before = [];
  let base = null, latest = null, curves = null, busy = false, again = false, whole = 0, resting = false, later = 0, closed = false, player = null, drawing = null;

  const query = () => new URLSearchParams([["blow", blow], ["scene", scene], ...[...set].map(([path, value]) => ["set", `${path}=${value}`])]);
  const doing = make("span", { class: "hint", role: "status" });
  const undo = make("button", { type: "button", disabled: true, onclick: takeBack }, "Undo");
  const reset = make("button", { type: "button", onclick: () => { keep(); set.clear(); for (const row of rows.values()) row.show(); changed(); } }, "Reset");
  const save = make("button", { type: "button", onclick: saveFile }, "Save as TOML");
  const moving = make("button", { type: "button", onclick: async () => {
    try { download((await ask(`/api/action/${at(name)}/animation?${query()}`)).text, `${name}-${blow}.html`, "text/html"); } catch (error) { say(error.message); }
  } }, "Save animation");
  const screwPart = make("fieldset", {}, make("legend", {}, "Screws"));
  const ofScene = facts.parameters.filter((one) => one.of_scene);
  const scenePart = make("fieldset", { hidden: !ofScene.length }, make("legend", {}, "Parameters of the scene"));
  const otherPart = make("fieldset", {}, make("legend", {}, "Other parameters"));
  const paths = make("datalist", { id: "paths" }, ...facts.parameters.filter((one) => !screws.has(one.path) && !one.of_scene).map((one) => make("option", { value: one.path }, one.name === one.path ? one.about : one.name)));
  const wanted = make("input", { list: "paths", id: "wanted", size: 28, onchange: () => { if (addRow(wanted.value.trim())) wanted.value = ""; } });
  const events = make("tbody");
  const left = make("div", { class: "settings" }), right = make("div", { class: "left" });
  const steps = make("div"), touch = touchPart(() => ask(`/api/action/${at(name)}/touch?${query()}`));
  otherPart.append(make("div", { class: "row" }, make("label", {}, "Add", wanted), paths, make("span", { class: "hint" }, `a path such as hammer.mass`)));
  left.append(...(ofScene.length > MOST_BEFORE ? [screwPart, scenePart] : [scenePart, screwPart]), otherPart, steps);
  choices.append(undo, reset, save, moving, doing);
  main.append(make("div", { class: "review action" }, left, right));
  for (const screw of facts.screws) screwPart.append(slider(screw.path, screw));
  for (const one of ofScene) scenePart.append(slider(one.path, one));
  for (const path of set.keys()) if (!rows.has(path)) addRow(path);
  main.addEventListener("keydown", onKey);

  /** What was set before the change that follows, for undo. */
  function keep() {
    before.push(new Map(set));
    if (before.length > MOST_UNDONE) before.shift();
    undo.disabled = false;
  }

  function takeBack() {
    const old = before.pop();
    if (!old) return;
    undo.disabled = !before.length;
    set.clear();
    for (const [path, value] of old) set.set(path, value);
    for (const row of rows.values()) row.show();
    changed();
  }

  function onKey(event) {
    if ((event.ctrlKey || event.metaKey) && event.key === "z" && event.target.type !== "text") { event.preventDefault(); takeBack(); }
  }

  function addRow(path) {
    if (!given.has(path)) { if (path) say(`no parameter ${path}`); return false; }
    if (!rows.has(path)) otherPart.append(slider(path, given.get(path)));
    rows.get(path).focus();
    return true;
  }

  /** A slider and a number of one parameter: how far it is from the action as given, 0 where it is as given. */
  function slider(path, { low, high, count, name: title }) {
    const one = given.get(path), [unit, times] = SHOWN[one.unit] ?? [one.unit, 1];
    const id = `set-${path}`, of = unit ? ` ${unit}` : "", steps_ = (value) => Number((times * (value - one.value)).toPrecision(7));
    const range = make("input", { type: "range", id, min: steps_(low), max: steps_(high), step: count ? 1 : times * (high - low) / 1000 });
    const number = make("input", { type: "number", step: "any", "aria-label": `${title}, change${unit ? ` in ${unit}` : ""}` });
    const told = make("span", { class: "values" });
    let begun = false;
    const take = (change) => {
      if (!begun) { keep(); begun = true; }
      if (change === 0) set.delete(path); else set.set(path, one.value + change / times);
      show();
      changed();
    };
    function show() {
      const value = set.get(path) ?? one.value, change = steps_(value);
      range.value = change;
      if (document.activeElement !== number) number.value = change;
      const share = change !== 0 && one.value && one.unit !== "m" && !count ? `, × ${(value / one.value).toPrecision(4)}` : "";
      told.textContent = `${change === 0 ? "as given" : "now"}: ${`${Number((times * value).toPrecision(6))}`.replace("-", "−")}${of}${share}`;
      range.setAttribute("aria-valuetext", `${change > 0 ? "+" : ""}${change}${of}, ${told.textContent}`);
    }
    range.addEventListener("input", () => take(Number(range.value)));
    range.addEventListener("change", () => { begun = false; });
    number.addEventListener("input", () => { if (number.value !== "" && Number.isFinite(Number(number.value))) take(Number(number.value)); });
    number.addEventListener("change", () => { begun = false; show(); });
    const target = screws.get(path)?.target;
    const row = make("div", { class: "slider" }, make("label", { for: id, title: `${path}${one.about ? `, ${one.about}` : ""}` }, title), range,
      make("span", {}, number, ` ${unit} `), told,
      target ? make("button", { type: "button", onclick: () => stepTable(steps, `/api/action/${at(name)}/step?${query()}`, target, title) }, "What does it do?") : null);
    rows.set(path, { show, focus: () => range.focus() });
    show();
    return row;
  }

  function changed() {
    const now = address().values;
    now.delete("set");
    for (const [path, value] of set) now.append("set", `${path}=${value}`);
    clearTimeout(changed.waiting); // browsers limit how often the address may change
    changed.waiting = setTimeout(() => { if (!closed) history.replaceState(null, "", link("action", now)); }, 300);
    save.disabled = set.size === 0 && scene === WHOLE;
    touch.old();
    play();
  }

  /** Ask for the blow as it is set now; while one is under way only the newest setting waits. */
  async function play() {
    if (busy) { again = true; return; }
    busy = true;
    const began = performance.now();
    const patience = setTimeout(() => { doing.textContent = "computing … (a law switched on or off is compiled first)"; }, 700);
    try {
      // the curves first; events, drawing and forces follow when the slider rests, and now and then
      const { values: drawn } = await ask(`/api/action/${at(name)}/curves?${query()}`);
      if (!closed) {
        drawn.forEach((value, k) => curves.replace(k + 1, 1, { value: unpack(value) }));
        if (doing.textContent) doing.textContent = "";
        main.dataset.latency = (performance.now() - began).toFixed(1);
      }
      if (!closed) restSoon();
    } catch (error) { doing.textContent = error.message; } finally { clearTimeout(patience); busy = false; }
    if (again && !closed) { again = false; play(); }
  }

  function restSoon() {
    clearTimeout(later);
    later = setTimeout(rest, performance.now() - whole > LONGEST_MS ? 0 : QUIET_MS);
  }

  /** Events, drawing and forces of what is set now. */
  async function rest() {
    if (closed) return;
    if (resting) { restSoon(); return; }
    resting = true;
    const asked = query().toString();
    try {
      latest = await ask(`/api/action/${at(name)}/blow?${asked}`);
      if (!closed) { draw(); main.dataset.drawn = asked; }
    } catch (error) { doing.textContent = error.message; } finally { resting = false; whole = performance.now(); }
  }

  const line = (found, value) => ({ time: unpack(found.time_s), value: unpack(value) });

  function draw() {
    drawing.set(latest.drawing);
    tell();
    player.events = latest.events.filter((event) => event.time_s !== null);
    player.draw();
  }

  function tell() {
    const text = (event) => (event.value === null ? event.note || "–" : `${Number.isInteger(event.value) ? event.value : event.value.toPrecision(5)} ${event.unit === "count" ? "" : event.unit}`);
    if (events.childElementCount === latest.events.length) { // only what can change: rows are costly to lay out
      latest.events.forEach((event, i) => { const cell = events.children[i].lastChild; if (cell.textContent !== text(event)) cell.textContent = text(event); });
      return;
    }
    events.replaceChildren(...latest.events.map((event, i) => make("tr", {}, make("th", { scope: "row", title: event.meaning }, event.title),
      make("td", { class: "number" }, text(base.events[i])), make("td", { class: "number" }, text(event)))));
  }

  async function saveFile() {
    try {
      const { text } = await ask(`/api/action/${at(name)}/file?${query()}`);
      download(text, `${name}-changed.toml`, "application/toml");
    } catch (error) { say(error.message); }
  }

  doing.textContent = "computing …";
  base = await ask(`/api/action/${at(name)}/blow?${new URLSearchParams({ blow, scene: beside })}`);
  latest = set.size || scene !== beside ? await ask(`/api/action/${at(name)}/blow?${query()}`).catch((error) => { say(error.message); return base; }) : base;
  doing.textContent = "";
  save.disabled = set.size === 0 && scene === WHOLE;
  if (closed) return null;
  const ink = getComputedStyle(document.documentElement).getPropertyValue("--soft").trim();
  const panels = [{ title: "Force on the key", unit: "N", height: 80, lines: [{ label: "", ...line(base, base.force_n), color: ink }] },
    ...Object.entries(latest.channels).map(([body, channel]) => ({
      title: channel.title[0].toUpperCase() + channel.title.slice(1), unit: "°", height: 90, digits: 3,
      lines: [{ label: givenAs, ...line(base, base.channels[body].value), color: ink, dash: "dotted", width: 1.2 }, { label: "now", ...line(latest, channel.value), color: channel.color, width: 2, live: true }],
    }))];
  const time = panels[0].lines[0].time, from = time[0], to = time[time.length - 1];
  drawing = new Drawing(latest.drawing, "Action as it is set");
  const place = make("div");
  player = new Player({
    from, to, at: Number(values.get("t")) || (base.events.find((event) => event.name === "string_impact") || {}).time_s || from, steps: null,
    events: latest.events.filter((event) => event.time_s !== null).map((event) => ({ ...event, source: "now" })),
    show: (t) => { curves?.at(t); drawing.at(t); },
  });
  right.append(player.element, drawing.element, place,
    make("div", { class: "scroll" }, make("table", { id: "events" }, make("caption", {}, `Events of the blow${latest.events.length ? "" : ": they need all bodies"}`), make("thead", {}, make("tr", {},
      ...["Event", givenAs, "now"].map((title, k) => make("th", { scope: "col", class: k ? "number" : null }, title)))), events)),
    touch.element, make("details", {}, make("summary", {}, "Keys"), make("p", {}, `${KEYS} Ctrl-Z takes the last change back. Nothing is written; “Save as TOML” gives a file for  --action.`)));
  curves = await Curves.show(place, panels, { from, to, name: `${name}-${blow}`, pick: (t) => { player.run(false); player.go(t); } });
  curves.zoom(from, Math.min(to, from + 0.35));
  tell();
  player.draw();
  main.dataset.ready = "true";
  return () => {
    closed = true;
    clearTimeout(changed.waiting);
    clearTimeout(later);
    main.removeEventListener("keydown", onKey);
    player.close();
    curves.close();
    delete main.dataset.ready;
    delete main.dataset.latency;
  };
}

/** A scene of one's own, typed or from a file; closed where a built-in one is chosen. */
function ownScene(text, use) {
  const typed = make("textarea", { id: "own-scene", rows: 6, spellcheck: "false", placeholder: EXAMPLE });
  typed.value = text;
  const file = make("input", { type: "file", accept: ".toml", "aria-label": "Scene file", onchange: async () => { typed.value = await file.files[0].text(); use(typed.value); } });
  return make("details", { open: text !== "" }, make("summary", {}, "A scene of your own"),
    make("label", { for: "own-scene" }, "Text of a scene file"), typed,
    make("div", { class: "row" }, make("button", { type: "button", onclick: () => { if (typed.value.trim()) use(typed.value); } }, "Use"), file));
}
