// One trial under one time cursor: curves, residuals, film, the moving action.
import { address, ask, at, link, make, remember, say } from "./bench.js";
import { Curves } from "./curves.js";
import { Drawing } from "./drawing.js";
import { FilmPanel } from "./film.js";
import { unpack } from "./numbers.js";
import { KEYS, Player } from "./player.js";

const DASHES = ["dashed", "dotted"];

export async function showReview(main, values) {
  const { sessions } = await ask("/api/sessions");
  const usable = sessions.filter((row) => row.trials > 0);
  if (!usable.length) { main.append(make("p", {}, "No session with trials here.")); return null; }
  const { actions } = await ask("/api/actions");
  const name = values.get("session") || usable[0].name;
  const session = await ask(`/api/sessions/${at(name)}`);
  const numbers = session.trials.map((trial) => trial.trial);
  const trial = Number(values.get("trial")) || numbers[0];
  const first = values.get("model") || actions[0], second = values.get("model2") || "";

  const choose = (id, title, options, value, key, rest) => {
    const select = make("select", { id, onchange: () => { location.hash = link("review", { ...kept(), ...rest, [key]: select.value }); } },
      ...options.map(([v, text]) => make("option", { value: v }, text)));
    select.value = value;
    return make("label", {}, title, select);
  };
  const kept = () => Object.fromEntries([...address().values].filter(([key]) => ["session", "trial", "model", "model2", "t"].includes(key)));
  const doing = make("p", { class: "hint", role: "status" }, "reading …");
  main.append(make("div", { class: "row" },
    choose("review-session", "Session", usable.map((row) => [row.name, row.name]), name, "session", { trial: "", t: "" }),
    choose("review-trial", "Trial", session.trials.map((one) => [one.trial, `${one.trial}${one.film ? ", film" : ""}${one.rejected === null ? "" : ", rejected"}`]), trial, "trial", {}),
    choose("review-model", "Model", actions.map((action) => [action, action]), first, "model", {}),
    choose("review-model2", "beside", [["", "–"], ...actions.filter((action) => action !== first).map((action) => [action, action])], second, "model2", {})), doing);
  if (!numbers.includes(trial)) throw new Error(`${name}: no trial ${trial}; there are ${numbers.join(", ")}`);

  const query = new URLSearchParams([["model", first], ...(second ? [["model", second]] : [])]);
  const [view, film] = await Promise.all([ask(`/api/review/${at(name)}/${trial}?${query}`), ask(`/api/film/${at(name)}/${trial}`)]);
  doing.remove();
  for (const note of [...view.notes, view.rejected === null ? null : `rejected: ${view.rejected}`, film.error].filter(Boolean)) main.append(make("p", { class: "notice" }, note));

  const panels = panelsOf(view);
  const [from, to] = span(panels);
  const left = make("div", { class: "left" }), right = make("div", { class: "right" });
  const picture = film.film ? new FilmPanel(name, trial, film.film) : null;
  const drawing = view.drawing ? new Drawing(view.drawing, view.drawing.measured ? "Measured and model" : "Model") : null;
  let curves = null, writing = null;
  const player = new Player({
    from, to, at: Number(values.get("t")) || (view.events.find((event) => event.name === "string_impact") || { time_s: from }).time_s,
    steps: film.film?.time_s ?? null, events: view.events,
    show: (t) => {
      curves?.at(t);
      picture?.show(t);
      drawing?.at(t);
      writing ??= setTimeout(() => { writing = null; remember({ t: player.time.toFixed(6) }); }, 300); // browsers limit how often
    },
  });
  const zoomed = make("button", { type: "button", "aria-pressed": "false", onclick: () => zoom(zoomed.getAttribute("aria-pressed") !== "true") }, "Zoom to the blow");
  const zoom = (is) => {
    zoomed.setAttribute("aria-pressed", String(is));
    const moments = view.events.map((event) => event.time_s);
    if (is && moments.length) curves.zoom(Math.min(...moments) - 0.01, Math.min(...moments) + 0.25); else curves.whole();
  };
  player.element.firstChild.append(zoomed);
  right.append(...[picture?.element, drawing?.element].filter(Boolean));
  main.append(player.element, make("div", { class: "review" }, left, right.childElementCount ? right : ""),
    make("details", {}, make("summary", {}, "Keys and signs"), make("p", {}, KEYS),
      make("p", {}, "Angles are changes since rest with the thesis's signs. Solid: measured; dashed: model, dotted: the second model; below each, model less measured. Force is corrected for offset, hum and delay.")));
  curves = await Curves.show(left, panels, { from, to, pick: (t) => { player.run(false); player.go(t); } });
  player.draw();
  main.dataset.ready = "true";
  window.benchPlayer = player; // for tests of the page
  window.benchFilm = picture;
  return () => { clearTimeout(writing); player.close(); curves.close(); picture?.close(); delete main.dataset.ready; };
}

function curve(packed) {
  return { time: unpack(packed.time_s), value: unpack(packed.value) };
}

/** Force, then of each body its angle and below it what the models miss. */
function panelsOf(view) {
  const ink = getComputedStyle(document.documentElement).getPropertyValue("--ink").trim();
  const panels = [{ title: "Force on the key", unit: "N", height: 100, lines: [{ label: "", ...curve(view.force), color: ink }] }];
  for (const channel of Object.values(view.channels)) {
    const lines = channel.measured ? [{ label: "measured", ...curve(channel.measured), color: channel.color, width: 2 }] : [];
    channel.models.forEach((line, k) => lines.push({ label: view.models[k], ...curve(line), color: ink, dash: DASHES[k], width: 1.3 }));
    if (!lines.length) continue;
    panels.push({ title: channel.title[0].toUpperCase() + channel.title.slice(1), unit: "°", height: 96, digits: 3, lines });
    if (channel.residuals.length) {
      panels.push({ title: `${channel.title}: model less measured`, unit: "°", height: 56, digits: 3,
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
