// One trial under one time cursor: curves, residuals, film, the moving action.
import { address, link, remember } from "./address.js";
import { Curves } from "./curves.js";
import { Drawing } from "./drawing.js";
import { make } from "./elements.js";
import { FilmPanel } from "./film.js";
import { unpack } from "./numbers.js";
import { KEYS, Player } from "./player.js";
import { ask, at } from "./server.js";
import { download, say } from "./user.js";

const DASHES = ["dashed", "dotted"], FORCE = "Force on the key";
const named = (channel) => channel.title[0].toUpperCase() + channel.title.slice(1);

/** A trial and its film as the server tells them. */
async function read(session, trial, models) {
  const query = new URLSearchParams(models.filter(Boolean).map((name) => ["model", name]));
  const [view, film] = await Promise.all([ask(`/api/review/${at(session)}/${trial}?${query}`), ask(`/api/film/${at(session)}/${trial}`)]);
  return { session, trial, view, film: film.film, problem: film.error };
}

/** How much later a second trial is: by the first event that both have; null where they share none. */
function lateness(one, other) {
  for (const event of one.events.filter(({ source }) => source === "measured")) {
    const same = other.events.find(({ source, name }) => source === "measured" && name === event.name);
    if (same) return { shift: same.time_s - event.time_s, title: event.title };
  }
  return null;
}

export async function showReview(main, values) {
  const { sessions } = await ask("/api/sessions");
  const usable = sessions.filter((row) => row.trials > 0);
  if (!usable.length) { main.append(make("p", {}, "No session with trials here.")); return null; }
  const { actions } = await ask("/api/actions");
  const name = values.get("session") || usable[0].name, otherName = values.get("session2") || "";
  const [session, otherSession] = await Promise.all([name, otherName].map((one) => (one ? ask(`/api/sessions/${at(one)}`) : null)));
  const numbersOf = (one) => one.trials.map((trial) => trial.trial), numbers = numbersOf(session);
  const trial = Number(values.get("trial")) || numbers[0];
  const otherTrial = otherSession ? Number(values.get("trial2")) || numbersOf(otherSession).find((n) => otherName !== name || n !== trial) || numbersOf(otherSession)[0] : 0;
  const first = values.get("model") || actions[0], second = values.get("model2") || "";

  const choose = (id, title, options, value, key, rest) => {
    const select = make("select", { id, onchange: () => { location.hash = link("review", { ...kept(), ...rest, [key]: select.value }); } },
      ...options.map(([v, text]) => make("option", { value: v }, text)));
    select.value = value;
    return make("label", {}, title, select);
  };
  const kept = () => Object.fromEntries([...address().values].filter(([key, value]) => value && ["session", "trial", "session2", "trial2", "model", "model2", "t"].includes(key)));
  const trials = (one) => one.trials.map((each) => [each.trial, `${each.trial}${each.film ? ", film" : ""}${each.rejected === null ? "" : ", rejected"}`]);
  const names = usable.map((row) => [row.name, row.name]);
  const doing = make("p", { class: "hint", role: "status" }, "reading …");
  main.append(make("div", { class: "row" },
    choose("review-session", "Session", names, name, "session", { trial: "", t: "" }), choose("review-trial", "Trial", trials(session), trial, "trial", {}),
    choose("review-session2", "beside trial of", [["", "no other trial"], ...names], otherName, "session2", { trial2: "" }),
    otherSession ? choose("review-trial2", "Trial", trials(otherSession), otherTrial, "trial2", {}) : null,
    choose("review-model", "Model", actions.map((action) => [action, action]), first, "model", {}),
    choose("review-model2", "beside model", [["", "–"], ...actions.filter((action) => action !== first).map((action) => [action, action])], second, "model2", {})), doing);
  if (!numbers.includes(trial)) throw new Error(`${name}: no trial ${trial}; there are ${numbers.join(", ")}`);
  if (otherSession && !numbersOf(otherSession).includes(otherTrial)) throw new Error(`${otherName}: no trial ${otherTrial}`);

  const [one, other] = await Promise.all([read(name, trial, [first, second]), otherSession ? read(otherName, otherTrial, [first]) : null]);
  doing.remove();
  const { view } = one, notes = [...view.notes, view.rejected === null ? null : `rejected: ${view.rejected}`, one.problem];
  const late = other ? lateness(view, other.view) : null, shift = late?.shift ?? 0;
  if (other) notes.push(...other.view.notes.map((note) => `beside: ${note}`), other.problem, late ? null : "The two trials have no event in common; each is shown from its own beginning.");
  for (const note of notes.filter(Boolean)) main.append(make("p", { class: "notice" }, note));

  const panels = panelsOf(view);
  if (other) addOther(panels, other.view, shift, otherName === name ? `trial ${otherTrial}` : `${otherName} ${otherTrial}`);
  const [from, to] = span(panels);
  const left = make("div", { class: "left" });
  const shown = [one, other].filter(Boolean).map((each, k) => ({
    title: `${each.session}, trial ${each.trial}`, shift: k ? shift : 0,
    film: each.film ? new FilmPanel(each.session, each.trial, each.film) : null,
    drawings: each.view.drawings.map((drawing, i) => new Drawing(drawing, `${drawing.measured ? "Measured and model" : "Model"}${view.models.length > 1 && !k ? ` ${view.models[i]}` : ""}${other ? `, ${each.session} ${each.trial}` : ""}`)),
  }));
  if (shown.some((each) => each.drawings.length)) Drawing.together(shown.flatMap((each) => each.drawings));
  const beside = shown.length > 1 || shown[0].drawings.length > 1;
  const columns = shown.length > 1 ? shown.map((each) => [make("h2", {}, each.title), each.film?.element, ...each.drawings.map((drawing) => drawing.element)])
    : beside ? [[shown[0].film?.element, shown[0].drawings[0].element], [shown[0].drawings[1].element]] : [[shown[0].film?.element, shown[0].drawings[0]?.element]];
  const pictures = columns.map((parts) => make("div", {}, ...parts.filter(Boolean)));
  let curves = null, writing = null;
  const player = new Player({
    from, to, at: Number(values.get("t")) || (view.events.find((event) => event.name === "string_impact") || { time_s: from }).time_s,
    steps: one.film?.time_s ?? null, events: view.events,
    show: (t) => {
      curves?.at(t);
      for (const each of shown) { each.film?.show(t + each.shift); for (const drawing of each.drawings) drawing.at(t + each.shift); }
      writing ??= setTimeout(() => { writing = null; remember({ t: player.time.toFixed(6) }); }, 300); // browsers limit how often
    },
  });
  const zoomed = make("button", { type: "button", "aria-pressed": "false", onclick: () => zoom(zoomed.getAttribute("aria-pressed") !== "true") }, "Zoom to the blow");
  const zoom = (is) => {
    zoomed.setAttribute("aria-pressed", String(is));
    const moments = view.events.map((event) => event.time_s);
    if (is && moments.length) curves.zoom(Math.min(...moments) - 0.01, Math.min(...moments) + 0.25); else curves.whole();
  };
  const keep = make("button", { type: "button", disabled: !view.drawings.length, onclick: async () => {
    const models = new URLSearchParams([first, second].filter(Boolean).map((model) => ["model", model]));
    try { download((await ask(`/api/review/${at(name)}/${trial}/animation?${models}`)).text, `${name}-trial-${trial}.html`, "text/html"); } catch (error) { say(error.message); }
  } }, "Save animation");
  player.element.firstChild.append(zoomed, keep);
  const right = make("div", { class: "right" }, ...(beside ? [] : pictures));
  main.append(player.element, beside ? make("div", { class: "pair" }, ...pictures) : "", make("div", { class: beside ? "review wide" : "review" }, left, right.childElementCount ? right : ""),
    make("details", {}, make("summary", {}, "Keys and signs"), make("p", {}, KEYS),
      make("p", {}, `Angles are changes since rest with the thesis's signs. Solid: measured; dashed: model, dotted: the second model; below each, model less measured. Force is corrected for offset, hum and delay.${late ? ` The trial beside is grey and moved by ${(1000 * shift).toFixed(2)} ms, so that “${late.title}” falls together.` : ""}`)));
  curves = await Curves.show(left, panels, { from, to, name: `${name}-trial-${trial}`, pick: (t) => { player.run(false); player.go(t); } });
  player.draw();
  main.dataset.ready = "true";
  window.benchPlayer = player; // for tests of the page
  window.benchFilm = shown[0].film;
  window.benchCurves = curves;
  return () => { clearTimeout(writing); player.close(); curves.close(); for (const each of shown) each.film?.close(); delete main.dataset.ready; };
}

/** The measured curves of a second trial into the same plots, moved so that a common event falls together. */
function addOther(panels, view, shift, label) {
  const soft = getComputedStyle(document.documentElement).getPropertyValue("--soft").trim();
  const add = (title, packed) => {
    const panel = panels.find((each) => each.title === title);
    if (!panel || !packed) return;
    const { time, value } = curve(packed);
    panel.lines.push({ label, time: time.map((t) => t - shift), value, color: soft, dash: "dotdash", width: 1.6 });
  };
  add(FORCE, view.force);
  for (const channel of Object.values(view.channels)) add(named(channel), channel.measured);
}

function curve(packed) {
  return { time: unpack(packed.time_s), value: unpack(packed.value) };
}

/** Force, then of each body its angle and below it what the models miss. */
function panelsOf(view) {
  const ink = getComputedStyle(document.documentElement).getPropertyValue("--ink").trim();
  const panels = [{ title: FORCE, unit: "N", height: 100, lines: [{ label: "", ...curve(view.force), color: ink }] }];
  for (const channel of Object.values(view.channels)) {
    const lines = channel.measured ? [{ label: "measured", ...curve(channel.measured), color: channel.color, width: 2 }] : [];
    channel.models.forEach((line, k) => lines.push({ label: view.models[k], ...curve(line), color: ink, dash: DASHES[k], width: 1.3 }));
    if (!lines.length) continue;
    panels.push({ title: named(channel), unit: "°", height: 96, digits: 3, lines });
    if (channel.residuals.length) {
      panels.push({ title: `${named(channel)}: model less measured`, unit: "°", height: 56, digits: 3,
        lines: channel.residuals.map((line, k) => ({ label: view.models[k], ...curve(line), color: channel.color, dash: k ? DASHES[1] : "solid", width: 1.2 })) });
    }
  }
  return panels;
}

function span(panels) {
  const ends = panels.flatMap((panel) => panel.lines).filter((line) => line.time.length).map((line) => [line.time[0], line.time[line.time.length - 1]]);
  if (!ends.length) { say("no samples"); return [0, 1]; }
  return [Math.min(...ends.map(([a]) => a)), Math.max(...ends.map(([, b]) => b))];
}
