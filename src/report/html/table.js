// Sorts and filters the table of a sweep.
const table = document.getElementById("cases");
if (table) {
  const body = table.tBodies[0];
  const heads = [...table.tHead.rows[0].cells];
  const names = heads.map((head) => head.textContent);
  const all = [...body.rows];
  const cell = (row, column) => row.cells[column].textContent;
  const compare = (a, b) => {
    // What is missing comes last, whichever way.
    const numbers = a !== "" && b !== "" && !isNaN(a) && !isNaN(b);
    return numbers ? a - b : a.localeCompare(b);
  };

  heads.forEach((head, column) => head.firstChild.addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    heads.forEach((other) => other.setAttribute("aria-sort", "none"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    all.sort((one, other) => {
      const [a, b] = [cell(one, column), cell(other, column)];
      if (a === "" || b === "") return (a === "") - (b === "");
      return down ? compare(b, a) : compare(a, b);
    });
    body.append(...all);
  }));

  const operators = {
    "<": (a, b) => a < b, ">": (a, b) => a > b, "<=": (a, b) => a <= b, ">=": (a, b) => a >= b, "=": (a, b) => a === b,
  };
  let unknown = [];
  const condition = (term) => {
    const parts = /^(.+?)(<=|>=|<|>|=)(.+)$/.exec(term);
    const column = parts ? names.indexOf(parts[1]) : -1;
    if (parts && column < 0) unknown.push(parts[1]);
    if (column < 0) return (row) => [...row.cells].some((one) => one.textContent.includes(term));
    const holds = operators[parts[2]];
    return (row) => {
      const [a, b] = [cell(row, column), parts[3]];
      return a !== "" && (isNaN(a) || isNaN(b) ? holds(a, b) : holds(Number(a), Number(b)));
    };
  };
  const filter = document.getElementById("filter");
  const apply = () => {
    unknown = [];
    const conditions = filter.value.split(/\s+/).filter(Boolean).map(condition);
    let count = 0;
    for (const row of all) {
      row.hidden = !conditions.every((holds) => holds(row));
      count += !row.hidden;
    }
    document.dispatchEvent(new CustomEvent("cases-shown", { detail: all.filter((row) => !row.hidden).map((row) => Number(row.dataset.case)) }));
    document.getElementById("shown").textContent = `${count} of ${all.length} cases${unknown.length ? `; no column is named ${unknown.join(", ")}` : ""}`;
  };
  filter.addEventListener("input", apply);
  apply();
}
