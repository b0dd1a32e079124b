// A plan played from the page: begin, pause before the next trial, resume, abort; the recorder's questions.
import { make } from "./elements.js";
import { ask, mayWrite } from "./server.js";
import { say } from "./user.js";

const AGAIN_MS = 1000;
const PHASES = { idle: "no plan is played from this page", starting: "starting …", asking: "waits for an answer", recording: "recording", paused: "paused", ended: "ended" };

/** The panel; `began(session)` is called with the name of a session that a plan has begun. */
export function planPanel(session, began) {
  const told = make("strong", { role: "status" }), more = make("span", { class: "hint" }), bar = make("progress", { max: 1, value: 0, hidden: true, "aria-label": "Trials of the plan" });
  const press = (title, what, kind = null) => make("button", { type: "button", class: kind, disabled: true, onclick: () => send(`/api/plan/${what}`, {}) }, title);
  const pause = press("Pause before the next trial", "pause"), resume = press("Resume", "resume", "first"), abort = press("Abort", "abort", "stop");
  const answer = make("input", { id: "plan-answer", size: 24, autocomplete: "off" }), question = make("label", { for: "plan-answer" });
  const reply = make("form", { class: "notice", hidden: true, onsubmit: (event) => { event.preventDefault(); send("/api/plan/answer", { question: state.question_number, text: answer.value }); answer.value = ""; } },
    question, " ", answer, " ", make("button", { type: "submit", class: "first" }, "Answer"));
  const form = make("form", { onsubmit: begin }), problem = make("p", { class: "notice", role: "alert", hidden: true });
  const element = make("section", { class: "plan", "aria-label": "Plan" }, make("div", { class: "row" }, told, more, bar), problem, reply, make("div", { class: "row" }, pause, resume, abort));
  let state = { phase: "idle" }, socket = null, closed = false, timer = 0, fields = null, shown = "", followed = "";

  async function send(path, body) {
    try { await ask(path, { method: "POST", body }); } catch (error) { say(error.message); }
  }

  /** What can be ordered, asked for once. */
  async function offer() {
    const { profiles, plans, bench } = await ask("/api/plan");
    const keep = JSON.parse(sessionStorage.getItem("plan") || "{}");
    const what = make("select", { name: "what" }, ...profiles.map((name) => make("option", { value: `profile ${name}` }, name)), ...plans.map((name) => make("option", { value: `plan ${name}` }, `plan ${name}`)));
    const trials = make("input", { name: "trials", type: "number", min: 1, max: 9999, value: keep.trials || 5 });
    const name = make("input", { name: "session", size: 20, placeholder: "by date and profile", value: keep.session || "" });
    const operator = make("input", { name: "operator", size: 12, value: keep.operator || localStorage.getItem("author") || "" });
    const action = make("input", { name: "action", size: 14, value: keep.action || "" });
    if (profiles.includes("forte")) what.value = "profile forte";
    if (keep.what && [...what.options].some((one) => one.value === keep.what)) what.value = keep.what;
    fields = { what, trials, session: name, operator, action };
    const count = make("label", {}, "Trials", trials);
    what.onchange = () => { count.hidden = what.value.startsWith("plan "); };
    what.onchange();
    form.oninput = () => sessionStorage.setItem("plan", JSON.stringify(Object.fromEntries(Object.entries(fields).map(([key, field]) => [key, field.value]))));
    form.replaceChildren(make("fieldset", {}, make("legend", {}, `Play on ${bench.backend}, rig ${bench.rig}`),
      make("div", { class: "row" }, make("label", {}, "Profile or plan", what), count, make("label", {}, "New session", name), make("label", {}, "Operator", operator), make("label", {}, "Action", action)),
      make("div", { class: "row" }, make("button", { type: "submit", class: "first" }, "Begin"),
        session ? make("button", { type: "button", onclick: () => order({ resume: session }) }, `Go on with ${session}`) : null,
        make("span", { class: "hint" }, "On hardware a self-test must have passed, and the recorder asks for the rig's name. Every trial is under the recorder's interlocks."))));
    element.append(form);
  }

  function begin(event) {
    event.preventDefault();
    const [kind, ...name] = fields.what.value.split(" ");
    order({ [kind]: name.join(" "), trials: Number(fields.trials.value), session: fields.session.value.trim(), operator: fields.operator.value, action: fields.action.value });
  }

  async function order(body) {
    problem.hidden = true;
    try { await ask("/api/plan", { method: "POST", body }); fields.session.value = ""; form.oninput(); } catch (error) { problem.textContent = error.message; problem.hidden = false; }
  }

  function draw() {
    const playing = !["idle", "ended"].includes(state.phase), mine = mayWrite() && playing;
    const words = state.phase === "paused" ? `paused before trial ${state.trial}, ${state.why}` : state.phase === "recording" ? `trial ${state.trial} of ${state.trials}${state.pause_wanted ? ", then pause" : ""}` : PHASES[state.phase] || state.phase;
    if (words !== shown) { told.textContent = words; shown = words; }
    const left = state.left_s === null || state.left_s === undefined || state.phase !== "recording" ? "" : `, ${Math.round(state.left_s)} s left`;
    more.textContent = state.phase === "recording" ? `${state.time_s.toFixed(1)} s${left}` : state.phase === "ended" ? state.message : "";
    more.className = state.phase === "ended" && state.code ? "problem" : "hint";
    bar.hidden = !playing || !state.trials;
    if (state.trials) bar.value = Math.min((state.trial - 1 + (state.phase === "recording" ? Math.min(state.time_s / (state.blow_end_s || 1), 1) : 0)) / state.trials, 1);
    pause.disabled = !mine || state.phase === "paused" || Boolean(state.pause_wanted);
    resume.disabled = !mine || !(state.phase === "paused" || state.pause_wanted);
    abort.disabled = !mine;
    reply.hidden = !(mine && state.phase === "asking");
    if (state.question && question.textContent !== state.question) { question.textContent = state.question; if (!reply.hidden) answer.focus(); }
    form.hidden = playing || !mayWrite();
    pause.hidden = resume.hidden = abort.hidden = !mayWrite();
  }

  function connect() {
    socket = new WebSocket(`ws://${location.host}/plan`);
    socket.onmessage = ({ data }) => {
      state = JSON.parse(data);
      if (mayWrite()) socket.send("seen"); // answered from here, not from a timer, which browsers slow down in hidden tabs
      if (state.phase === "recording" && state.session !== followed) { followed = state.session; began(followed); }
      draw();
    };
    socket.onclose = () => { if (!closed) { told.textContent = shown = "the bench does not answer; a plan pauses before its next trial"; timer = setTimeout(connect, AGAIN_MS); } };
  }

  draw();
  connect();
  if (mayWrite()) offer().then(draw, (error) => say(error.message));
  return { element, close() { closed = true; clearTimeout(timer); socket?.close(); } };
}
