// The table of sessions and the session that was chosen.
import { address, link, remember } from "./address.js";
import { annotationForm } from "./annotations.js";
import { make } from "./elements.js";
import { jobButton } from "./jobs.js";
import { ask, at, LOOK_ONLY, mayWrite } from "./server.js";
import { say } from "./user.js";

const COLUMNS = [
  ["name", "Session"], ["created_utc", "Recorded (UTC)"], ["action", "Action"], ["profile", "Profile"], ["operator", "Operator"],
  ["trials", "Trials"], ["status", "Status"], ["n_findings", "Findings"], ["verdict", "Verdict"],
];
const NUMBERS = new Set(["trials", "n_findings"]);

export async function showSessions(main, values) {
  let rows = [], ended = false;
  const search = make("input", { type: "search", id: "search", value: values.get("search") || "", oninput: draw });
  const count = make("span", { class: "hint", role: "status" });
  const body = make("tbody");
  const heads = COLUMNS.map(([key, title]) => make("th", { scope: "col", class: NUMBERS.has(key) ? "number" : null, "data-key": key },
    make("button", { type: "button", onclick: () => sortBy(key) }, title)));
  const chosen = make("section", { "aria-label": "Chosen session" }), several = make("section", { "aria-label": "Comparisons" });
  const ticked = new Set();
  main.append(
    make("div", { class: "row" }, make("label", {}, "Search", search), make("button", { type: "button", onclick: load }, "Read again"), count),
    make("div", { class: "scroll" }, make("table", { id: "sessions" }, make("thead", {}, make("tr", {}, ...heads, make("th", { scope: "col" }, "Compare"))), body)), chosen, several);

  function sortBy(key) {
    const { values: now } = address();
    const down = now.get("sort") === key && now.get("down") !== "1";
    remember({ sort: key, down: down ? "1" : null });
    draw();
  }

  function draw() {
    remember({ search: search.value });
    const { values: now } = address();
    const key = now.get("sort") || "created_utc", down = now.has("sort") ? now.get("down") === "1" : true;
    for (const head of heads) {
      if (head.dataset.key === key) head.setAttribute("aria-sort", down ? "descending" : "ascending"); else head.removeAttribute("aria-sort");
    }
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const text = (row) => COLUMNS.map(([k]) => row[k]).concat(row.sentence, row.problem, row.findings, row.simulated ? "simulated" : "").join(" ").toLowerCase();
    const found = rows.filter((row) => words.every((word) => text(row).includes(word)));
    const empty = (value) => value === "" || value === null;
    found.sort((a, b) => {
      const [x, y] = [a[key], b[key]];
      if (empty(x) !== empty(y)) return empty(x) ? 1 : -1; // what is not known comes last either way
      const order = typeof x === "number" ? x - y : String(x).localeCompare(String(y), "en", { numeric: true });
      return down ? -order : order;
    });
    body.replaceChildren(...found.map((row) => line(row, now.get("session"))));
    count.textContent = `${found.length} of ${rows.length} sessions`;
  }

  function line(row, session) {
    const open = make("a", { href: link("sessions", { ...Object.fromEntries(address().values), session: row.name }) }, row.name);
    const cells = COLUMNS.slice(1).map(([key]) => {
      if (key === "status" && row.problem && row.status === "unreadable") return make("td", { class: "text problem" }, `unreadable: ${row.problem}`);
      if (key === "verdict") {
        const kind = row.verdict === "agrees" ? "agrees" : row.verdict.startsWith("differs") ? "error" : "";
        return make("td", { class: kind }, row.verdict || (row.report ? "see report" : "–"), row.stale ? make("span", { class: "stale" }, " (older than the trials)") : null);
      }
      if (key === "trials") return make("td", { class: "number" }, row.rejected ? `${row.trials}, ${row.rejected} rejected` : String(row.trials));
      if (key === "n_findings") return make("td", { class: "number" }, row.verdict || row.n_findings ? String(row.n_findings) : "–");
      if (key === "action" && row.simulated) return make("td", { class: "text" }, `${row.action} (simulated)`);
      return make("td", { class: key === "created_utc" ? "when" : "text" }, String(row[key] || "–").replace("T", " ").replace(/(\+00:00|Z)$/, ""));
    });
    const tick = make("input", { type: "checkbox", "aria-label": `Compare ${row.name}`, checked: ticked.has(row.name), disabled: !row.trials, onchange: () => { if (tick.checked) ticked.add(row.name); else ticked.delete(row.name); } });
    return make("tr", { "aria-selected": String(row.name === session) }, make("th", { scope: "row" }, open), ...cells, make("td", {}, tick));
  }

  async function load() {
    count.textContent = "reading …";
    try { rows = (await ask("/api/sessions")).sessions; } catch (error) { count.textContent = ""; say(error.message); return; }
    if (!ended) draw();
  }

  await load();
  await showComparisons(several, ticked, () => ended);
  if (values.get("session")) await showOne(chosen, values.get("session"), load, () => ended);
  return () => { ended = true; };
}

async function showOne(place, name, reload, ended) {
  let session;
  try { session = await ask(`/api/sessions/${at(name)}`); } catch (error) {
    place.replaceChildren(make("p", { class: "notice", role: "alert" }, error.message));
    return;
  }
  const again = async () => { await showOne(place, name, reload, ended); await reload(); };
  const report = make("div");
  const trials = session.trials.map((trial) => make("tr", {},
    make("th", { scope: "row" }, make("a", { href: link("review", { session: name, trial: trial.trial }) }, `Review trial ${trial.trial}`)),
    make("td", {}, trial.status),
    make("td", { class: "text" }, trial.rejected === null ? "counts" : `rejected: ${trial.rejected}`),
    make("td", {}, trial.film ? make("a", { href: link("outlines", { film: name, trial: trial.trial }) }, `${trial.film}${trial.tracked ? ", tracked" : ", not tracked"}`) : "–")));
  const notes = session.annotations.map((note) => make("li", {},
    `${note.time_utc.replace("T", " ").replace(/(\+00:00|Z)$/, "")}, ${note.trial ? `trial ${note.trial}` : "session"}: ${note.kind}, ${note.reason} (${note.author})`));
  const see = make("button", { type: "button", class: "first", disabled: !session.report, onclick: () => showReport(report, name, see) }, "Show report");
  place.replaceChildren(...[
    make("h2", { id: "chosen", tabindex: "-1" }, session.name),
    session.problem ? make("p", { class: "notice" }, session.problem) : null,
    session.sentence ? make("p", {}, session.sentence) : null,
    session.findings.length ? make("ul", {}, ...session.findings.map((text) => make("li", {}, text))) : null,
    session.stale ? make("p", { class: "stale" }, "Trials were added, rejected or accepted since this report; make it again.") : null,
    make("div", { class: "row" }, see, makeReport(name, again, ended)),
    report,
    make("div", { class: "scroll" }, make("table", { id: "trials" }, make("caption", {}, "Trials"), make("thead", {}, make("tr", {},
      ...["Trial", "Status", "Counts?", "Film"].map((title) => make("th", { scope: "col" }, title)))), make("tbody", {}, ...trials))),
    make("h3", {}, "Annotations"),
    notes.length ? make("ul", { id: "annotations" }, ...notes) : make("p", { class: "hint" }, "None."),
    mayWrite() ? annotationForm(name, session.trials, again) : make("p", { class: "hint" }, LOOK_ONLY),
  ].filter(Boolean));
  if (address().values.get("report") === "1" && session.report) showReport(report, name, see);
}

/** Reports of several sessions: those that were made, and a new one of the ticked sessions. */
async function showComparisons(place, ticked, ended) {
  const { comparisons } = await ask("/api/comparisons");
  const report = make("div");
  const open = (name) => report.replaceChildren(make("iframe", { class: "report", title: `Comparison ${name}`, src: `/report-of-several/${at(name)}/report.html`, sandbox: "allow-scripts allow-downloads allow-popups" }));
  place.replaceChildren(make("h2", {}, "Side by side"),
    make("div", { class: "row" }, jobButton({
      kept: "job compare", title: "Compare ticked sessions", disabled: !mayWrite(), hint: LOOK_ONLY, ended,
      begin: () => {
        if (ticked.size < 2) throw new Error("tick at least two sessions in the column Compare");
        return ask("/api/comparisons", { method: "POST", body: { sessions: [...ticked] } });
      },
      done: async () => { say("compared"); await showComparisons(place, ticked, ended); },
    }), ...comparisons.slice(0, 12).map((name) => make("button", { type: "button", onclick: () => open(name) }, name))), report);
}

function showReport(place, name, button) {
  const shown = place.childElementCount > 0;
  remember({ report: shown ? null : "1" });
  button.textContent = shown ? "Show report" : "Hide report";
  if (shown) { place.replaceChildren(); return; }
  const source = `/report/${at(name)}/report.html`;
  place.replaceChildren(
    make("iframe", { class: "report", title: `Report of ${name}`, src: source, sandbox: "allow-scripts allow-downloads allow-popups" }));
}

/** A button that makes the report. */
function makeReport(name, again, ended) {
  return jobButton({
    kept: `job validate ${name}`, title: "Validate", disabled: !mayWrite(), hint: LOOK_ONLY, ended,
    begin: () => ask(`/api/sessions/${at(name)}/validate`, { method: "POST", body: {} }),
    done: async () => { say(`report of ${name} is made`); await again(); },
  });
}
