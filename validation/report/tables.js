/* Tables: a click on a head sorts, a second one turns the order round. Print shows the methods too. */
for (const table of document.querySelectorAll("table.sorts")) {
  const body = table.tBodies[0], rows = [...body.rows];
  const value = (row, i) => {
    const text = row.cells[i]?.textContent.trim() ?? "";
    const number = text.replace(/\u2212/g, "-").match(/^<?\s*(-?\d+(?:\.\d+)?)(?=$|[\s%\u00b0(:])/);
    return text === "\u2013" || text === "" ? null : number ? +number[1] : text;
  };
  const compare = (a, b) => typeof a === "number" && typeof b === "number" ? a - b
    : String(a).localeCompare(String(b), "en", { numeric: true });
  for (const head of rows.length > 1 ? table.tHead.rows[0].cells : []) {
    if (!head.textContent.trim()) continue;
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1, i = head.cellIndex;
      for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
      const keyed = [...body.rows].map((row) => [value(row, i), row]);
      const known = keyed.filter(([v]) => v !== null).sort((a, b) => sign * compare(a[0], b[0]));
      body.append(...known.map(([, row]) => row), ...keyed.filter(([v]) => v === null).map(([, row]) => row));
    });
  }
}
const opened = [];
addEventListener("beforeprint", () => {
  for (const part of document.querySelectorAll("details.printed:not([open])")) { part.open = true; opened.push(part); }
});
addEventListener("afterprint", () => { for (const part of opened.splice(0)) part.open = false; });
