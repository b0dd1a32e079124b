// Notes, rejections and acceptances; what was typed is kept in this browser tab until it is sent.
import { make } from "./elements.js";
import { ask, at } from "./server.js";
import { say } from "./user.js";

const KINDS = [["note", "Note"], ["reject", "Reject"], ["accept", "Accept again"]];

export function annotationForm(name, trials, done) {
  const kept = `draft ${name}`;
  const draft = JSON.parse(sessionStorage.getItem(kept) || "{}");
  const trial = make("select", { id: "note-trial" }, make("option", { value: "0" }, "session"),
    ...trials.map((one) => make("option", { value: one.trial }, `trial ${one.trial}`)));
  const kind = make("select", { id: "note-kind" }, ...KINDS.map(([value, title]) => make("option", { value }, title)));
  const reason = make("textarea", { id: "note-reason", maxlength: "2000" });
  const author = make("input", { id: "note-author", maxlength: "200", autocomplete: "name" });
  trial.value = draft.trial ?? "0";
  kind.value = draft.kind ?? "note";
  reason.value = draft.reason ?? "";
  author.value = draft.author ?? localStorage.getItem("author") ?? "";
  const keep = () => sessionStorage.setItem(kept, JSON.stringify({ trial: trial.value, kind: kind.value, reason: reason.value, author: author.value }));

  async function send(event) {
    event.preventDefault();
    const body = { trial: Number(trial.value), kind: kind.value, reason: reason.value, author: author.value };
    try {
      await ask(`/api/sessions/${at(name)}/annotations`, { method: "POST", body });
      localStorage.setItem("author", author.value);
      sessionStorage.removeItem(kept);
      say("noted");
      await done();
    } catch (error) { say(error.message); }
  }

  return make("form", { onsubmit: send, oninput: keep },
    make("fieldset", {}, make("legend", {}, "Annotate"),
      make("div", { class: "row" }, make("label", {}, "About", trial), make("label", {}, "What", kind), make("label", {}, "Author", author)),
      make("label", { for: "note-reason" }, "Text or reason"), reason,
      make("div", { class: "row" }, make("button", { type: "submit", class: "first" }, "Write"),
        make("span", { class: "hint" }, "Lines are added, nothing is changed or deleted."))));
}
