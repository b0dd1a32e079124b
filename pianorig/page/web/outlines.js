// From a film to angles: outlines drawn, saved, tracked; the worst frames, placed by hand and tracked again.
import { link, remember } from "./address.js";
import { OutlineEditor } from "./editor.js";
import { make } from "./elements.js";
import { FilmPanel } from "./film.js";
import { jobButton } from "./jobs.js";
import { ask, at, LOOK_ONLY, mayWrite } from "./server.js";
import { say } from "./user.js";

const USUAL = ["key", "whippen", "jack", "repetition", "hammer"];
const CARRIED = { jack: "whippen", repetition: "whippen" };

/** Films of sessions as [session, trial], films on their own with the trial 0. */
async function allFilms() {
  const [{ sessions }, { films }] = await Promise.all([ask("/api/sessions"), ask("/api/films")]);
  const details = await Promise.all(sessions.filter((row) => row.trials).map((row) => ask(`/api/sessions/${at(row.name)}`)));
  const found = films.map((name) => ({ owner: name, trial: 0, title: name }));
  for (const one of details) for (const trial of one.trials) if (trial.film) found.push({ owner: one.name, trial: trial.trial, title: `${one.name}, trial ${trial.trial}` });
  return found;
}

export async function showOutlines(main, values) {
  const films = await allFilms();
  if (!films.length) {
    main.append(make("p", {}, "No film here. Put a film into the folder of the sessions, or attach one to a trial:  pianorig attach"));
    return null;
  }
  const wanted = films.find((one) => one.owner === values.get("film") && String(one.trial) === (values.get("trial") || "0"))
    || films.find((one) => one.owner === values.get("film")) || films[0];
  const { owner, trial } = wanted, base = `/api/outlines/${at(owner)}/${trial}`;
  const select = make("select", { onchange: () => { const one = films[select.value]; location.hash = link("outlines", { film: one.owner, trial: one.trial }); } },
    ...films.map((one, i) => make("option", { value: i }, one.title)));
  select.value = films.indexOf(wanted);
  main.append(make("div", { class: "row" }, make("label", {}, "Film", select)));
  let closed = false, known = await ask(base);
  const panel = new FilmPanel(owner, trial, known.film);
  const kept = `outlines ${owner} ${trial}`;
  const editor = new OutlineEditor(panel, JSON.parse(sessionStorage.getItem(kept) || "null") || known.outlines, (bodies, dirty) => {
    if (dirty) sessionStorage.setItem(kept, JSON.stringify(bodies));
    list();
  });
  const slider = make("input", { type: "range", min: 0, max: known.film.n_frames - 1, value: values.get("frame") || 0, "aria-label": "Frame", oninput: () => go(Number(slider.value)) });
  const rows = make("div"), worst = make("ol", { class: "worst" }), hints = make("p", { class: "hint" });
  const saveButton = make("button", { type: "button", class: "first", disabled: !mayWrite(), title: mayWrite() ? null : LOOK_ONLY, onclick: save }, "Save");
  const rate = make("input", { type: "number", min: "0", step: "any", id: "rate", placeholder: "from the file" });
  const again = make("button", { type: "button", disabled: true, onclick: trackFrame }, "Track this frame again");
  const still = make("button", { type: "button", onclick: () => go(0) }, "To the still frames");
  const track = jobButton({
    kept: `job track ${owner} ${trial}`, title: "Track", disabled: !mayWrite(), hint: LOOK_ONLY, ended: () => closed,
    begin: async () => {
      if (!(await save())) throw new Error("outlines are not saved, so nothing is tracked");
      return ask(`${base}/track`, { method: "POST", body: rate.value ? { frame_rate_hz: Number(rate.value) } : {} });
    },
    done: async () => { say("tracked"); await reload(); },
  });
  main.append(known.doubt ? make("p", { class: "notice" }, known.doubt) : "",
    make("div", { class: "review" }, make("div", {}, panel.element, slider, hints),
      make("div", {}, make("div", { class: "row" }, make("button", { type: "button", onclick: () => editor.add() }, "New body"), make("button", { type: "button", onclick: () => editor.undo() }, "Undo"), saveButton),
        rows, make("fieldset", {}, make("legend", {}, "Track"), trial === 0 ? make("p", {}, make("label", { for: "rate" }, "True frame rate, frames/s"), " ", rate) : "", track),
        make("fieldset", {}, make("legend", {}, "Worst frames"), worst, make("div", { class: "row" }, again, still),
          make("p", { class: "hint" }, "Drag a tracked outline to where the body is, [ and ] turn it; then track this frame again. By keys, on the picture: B chooses a body, the arrows move it.")))),
    make("details", { open: !known.outlines.length }, make("summary", {}, "How to draw"),
      make("p", {}, "Outlines lie on the still frames at the start. Click corner after corner; a click on the first corner closes the outline, after that a click adds a point in the nearest edge; drag a point to move it, arrow keys move the chosen one by a pixel (with Shift a tenth, with Ctrl ten), Delete takes it away, Ctrl-Z takes the last change back. Without a pointer: Enter on the picture sets a corner, the arrows move it. A body in front has the larger layer; its parent is the body it turns on."),
      make("p", {}, `Outlines are in ${known.file}, angles in ${known.table || "the table that tracking writes"} beside the film${trial ? ", and in the session" : ""}.`)));
  panel.told = (index) => {
    slider.value = index;
    slider.setAttribute("aria-valuetext", `frame ${index}`);
    again.disabled = !mayWrite() || !editor.placed.size;
    remember({ frame: index || null });
  };
  editor.elsewhere = () => say("outlines are drawn on the first frame: go to the still frames");
  editor.onPlaced = () => { again.disabled = !mayWrite(); };

  function go(index) { editor.forgetPlaces(); panel.frame(Math.min(Math.max(index, 0), known.film.n_frames - 1)); }

  /** Another name for a body; children follow, and a usual body gets its usual parent. */
  function rename(body, name) {
    editor.keep();
    const old = body.name;
    body.name = name;
    for (const other of editor.bodies) if (other.parent === old) other.parent = name;
    for (const other of editor.bodies) if (!other.parent && CARRIED[other.name] && editor.bodies.some((one) => one.name === CARRIED[other.name])) other.parent = CARRIED[other.name];
    editor.changed();
  }

  /** The usual names that are still free, for a body that has none yet. */
  function names() {
    const body = editor.bodies[editor.chosen];
    if (!body || !/^body\d+$/.test(body.name)) return "";
    const free = USUAL.filter((name) => !editor.bodies.some((one) => one.name === name));
    return make("div", { class: "row", role: "group", "aria-label": `Name ${body.name}` }, `${body.name} is the`, ...free.map((name) => make("button", { type: "button", onclick: () => rename(body, name) }, name)));
  }

  function list() {
    rows.replaceChildren(editor.bodies.length ? make("div", { class: "outline hint" }, make("span", {}, "Outline"), make("span", {}, "Name"), make("span", {}, "Parent"), make("span", {}, "Layer"), make("span")) : "", ...editor.bodies.map((body, i) => {
      const name = make("input", { value: body.name, list: "usual", size: 12, "aria-label": `Name of body ${i + 1}`, onclick: () => { if (/^body\d+$/.test(name.value)) name.select(); }, onchange: () => rename(body, name.value.trim()) });
      const parent = make("select", { "aria-label": `Parent of ${body.name}`, onchange: () => { editor.keep(); body.parent = parent.value; editor.changed(); } },
        make("option", { value: "" }, "turns on the frame"), ...editor.bodies.filter((one) => one !== body).map((one) => make("option", { value: one.name }, `turns on ${one.name}`)));
      parent.value = body.parent;
      const layer = make("input", { type: "number", step: "1", value: body.layer, "aria-label": `Layer of ${body.name}`, onchange: () => { editor.keep(); body.layer = Math.round(Number(layer.value)); editor.changed(); } });
      return make("div", { class: "outline", "aria-current": i === editor.chosen ? "true" : null },
        make("button", { type: "button", "aria-pressed": String(i === editor.chosen), onclick: () => editor.choose(i) }, make("span", { class: "swatch", style: `background:${editor.color(i)}` }), ` ${body.points.length} points`),
        name, parent, layer, make("button", { type: "button", "aria-label": `Delete ${body.name}`, onclick: () => editor.remove(i) }, "✕"));
    }), names(), make("datalist", { id: "usual" }, ...USUAL.map((text) => make("option", { value: text }))));
    hints.textContent = editor.bodies.length ? "" : "No outlines yet: begin with a new body and click its corners.";
  }

  function showWorst() {
    worst.replaceChildren(...known.worst.map((one) => make("li", {}, make("button", { type: "button", onclick: () => go(one.frame) }, `frame ${one.frame}`), ` ${one.words}`)));
    if (!known.worst.length) worst.replaceChildren(make("li", { class: "none" }, "Not tracked yet."));
  }

  async function reload() {
    known = await ask(base);
    if (closed) return;
    panel.film = known.film;
    panel.setBodies(known.film.bodies);
    editor.forgetPlaces();
    showWorst();
    panel.draw(panel.shown);
  }

  async function save() {
    try {
      const done = await ask(base, { method: "POST", body: { bodies: editor.bodies.map(({ name, parent, layer, points }) => ({ name, parent, layer, points })) } });
      sessionStorage.removeItem(kept);
      say(`saved: ${done.bodies.join(", ")} in ${done.file}`);
      return true;
    } catch (error) { say(error.message); return false; }
  }

  async function trackFrame() {
    again.disabled = true;
    try {
      const { lost } = await ask(`${base}/frame`, { method: "POST", body: { frame: panel.shown, places: Object.fromEntries(editor.placed) } });
      say(lost.length ? `still lost: ${lost.join(", ")}` : "found");
      await reload();
    } catch (error) { say(error.message); again.disabled = false; }
  }

  list();
  showWorst();
  panel.frame(Number(values.get("frame")) || 0);
  main.dataset.ready = "true";
  window.benchEditor = editor; // for tests of the page
  return () => { closed = true; editor.close(); panel.close(); delete main.dataset.ready; };
}
