"use strict";
// A click on a column's head sorts the table by the first number in each cell, or by its text; a second click turns it round.
for (const table of document.querySelectorAll("article table:not([class]), article table.dataframe")) {
  table.removeAttribute("class"); // those of notebooks look like the others
  if (!table.tHead || table.tBodies[0].rows.length < 2) continue;
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const key = (row) => {
      const text = row.cells[column].textContent.trim();
      const number = /^[^\w-]*(-?\d[\d\u2009]*(?:\.\d+)?(?:e[-+]?\d+)?)( m\b)?/.exec(text);
      const scale = number && number[2] ? 1000 : 1; // metres among millimetres
      return [number ? scale * Number(number[1].replace(/\u2009/g, "")) : NaN, text];
    };
    const sort = () => {
      const order = head.getAttribute("aria-sort") === "ascending" ? "descending" : "ascending";
      heads.forEach((each) => each.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", order);
      const sign = order === "ascending" ? 1 : -1;
      const compare = (a, b) => {
        const [x, s] = key(a), [y, t] = key(b);
        if (Number.isNaN(x) && Number.isNaN(y)) return sign * s.localeCompare(t);
        if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y);
        return sign * (x - y);
      };
      table.tBodies[0].append(...[...table.tBodies[0].rows].sort(compare));
    };
    head.tabIndex = 0;
    head.addEventListener("click", sort);
    head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
  });
  table.dataset.sorts = "";
}
