"use strict";
// The index: a filter by words and kinds, and columns that sort. Without this script all of it shows.
const find = document.getElementById("find");
const body = document.querySelector("#index tbody");
const kinds = [...document.querySelectorAll("input[name=kind]")];

function filter() {
  const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
  const on = new Set(kinds.filter((kind) => kind.checked).map((kind) => kind.value));
  let count = 0;
  for (const row of body.rows) {
    const text = row.textContent.toLowerCase();
    row.hidden = !(on.has(row.dataset.kind) && words.every((word) => text.includes(word)));
    count += !row.hidden;
  }
  document.getElementById("found").textContent = count + " of " + body.rows.length;
}

function sort(column, button) {
  const head = button.parentElement;
  const up = head.getAttribute("aria-sort") !== "ascending";
  // fig2 before fig10: digits count as numbers.
  const order = new Intl.Collator("en", { numeric: true }).compare;
  const text = (row) => row.cells[column].textContent;
  const rows = [...body.rows].sort((a, b) => (up ? 1 : -1) * order(text(a), text(b)));
  for (const other of document.querySelectorAll("#index th")) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  body.append(...rows);
}

find.addEventListener("input", filter);
kinds.forEach((kind) => kind.addEventListener("change", filter));
document.querySelectorAll("#index th button").forEach((button, column) => {
  button.addEventListener("click", () => sort(column, button));
});
filter();
