"use strict";
// The leaderboard: filters, search, and a dialog with the conditions of a score. Sorting is done by sortable.min.js.
const Board = (() => {
  const FIELDS = ["benchmark", "table", "method", "column", "domain", "kind", "protocol", "unit", "machine", "rank", "ade", "low", "high", "error", "seeds", "fde", "best", "k", "versus", "time", "conditions"];
  const TEXTS = 9;
  const COLUMNS = [
    ["rank", "Rank"], ["method", "Method"], ["column", "Column"], ["ade", "ADE"], ["unit", "Unit"], ["interval", "95 % interval"], ["error", "± seeds"], ["seeds", "Seeds"],
    ["versus", "Against constant velocity"], ["fde", "FDE"], ["best", "minADE"], ["conditions", "Conditions"], ["kind", "Kind"], ["protocol", "Protocol"],
    ["time", "ms a forecast"], ["domain", "Domain"], ["table", "Table"], ["machine", "Computed on"],
  ];
  const FILTERS = [["benchmark", "Benchmark"], ["table", "Table"], ["column", "Column"], ["kind", "Kind"], ["protocol", "Protocol"]];
  let rows, colors, state = {}, onChange;

  const number = (value) => value === null ? "" : Math.abs(value) >= 100 ? value.toFixed(0) : Math.abs(value) >= 10 ? value.toFixed(2) : value.toFixed(3);
  const signed = (value) => (value > 0 ? "+" : "") + number(value);

  function setUp(data, colorOf, changed) {
    colors = colorOf; onChange = changed;
    rows = data.rows.map((values) => {
      const row = Object.fromEntries(FIELDS.map((field, i) => [field, i < TEXTS ? data.texts[values[i]] : values[i]]));
      row.texts = row.conditions.map((i) => data.texts[i]);
      return row;
    });
    const head = document.querySelector("#board thead").insertRow();
    for (const [name, title] of COLUMNS) {
      const th = document.createElement("th");
      th.scope = "col"; th.textContent = title;
      if (name === "conditions") th.className = "no-sort"; else makeSortable(th);
      head.append(th);
    }
    const controls = document.getElementById("filters");
    for (const [name, title] of FILTERS) {
      const select = document.createElement("select");
      select.dataset.filter = name;
      select.addEventListener("change", () => {
        const next = {...state, [name]: select.value};
        if (name === "benchmark") { delete next.table; delete next.column; }
        if (name === "table") delete next.column;
        onChange(next);
      });
      controls.append(labelled(title, select));
    }
    const search = document.createElement("input");
    search.type = "search"; search.dataset.filter = "q";
    search.addEventListener("input", () => onChange({...state, q: search.value}));
    controls.append(labelled("Search in methods, domains and conditions", search));
  }

  function labelled(title, element) {
    const label = document.createElement("label");
    label.append(title, element);
    return label;
  }

  function show(asked) {
    state = {...asked};
    const benchmarks = [...new Set(rows.map((row) => row.benchmark))];
    if (state.benchmark === undefined || (state.benchmark && !benchmarks.includes(state.benchmark))) state.benchmark = benchmarks.includes("places") ? "places" : benchmarks[0];
    let shown = rows;
    for (const [name] of FILTERS) {
      const values = [...new Set(shown.map((row) => row[name]))];
      if (state[name] && !values.includes(state[name])) delete state[name];
      fill(document.querySelector(`[data-filter=${name}]`), values, state[name] ?? "");
      if (state[name]) shown = shown.filter((row) => row[name] === state[name]);
    }
    const search = document.querySelector("[data-filter=q]");
    if (search.value !== (state.q ?? "")) search.value = state.q ?? "";
    const words = (state.q ?? "").toLowerCase().split(/\s+/).filter(Boolean);
    shown = shown.filter((row) => { const text = [row.method, row.domain, row.table, row.kind, ...row.texts].join(" ").toLowerCase(); return words.every((word) => text.includes(word)); });
    const body = document.querySelector("#board tbody");
    body.replaceChildren(...shown.map(line));
    document.querySelectorAll("#board th[aria-sort]").forEach((th) => th.removeAttribute("aria-sort"));
    document.getElementById("count").textContent = `${shown.length} of ${rows.length} rows`;
  }

  function fill(select, values, chosen) {
    select.replaceChildren(new Option("all", ""), ...values.map((value) => new Option(value, value)));
    select.value = chosen;
  }

  function line(row) {
    const tr = document.createElement("tr");
    for (const [name] of COLUMNS) {
      const cell = tr.appendChild(document.createElement(name === "method" ? "th" : "td"));
      if (name === "method") {
        cell.scope = "row";
        const swatch = cell.appendChild(document.createElement("span"));
        swatch.className = "swatch"; swatch.style.background = colors[row.method];
        cell.appendChild(document.createElement("code")).textContent = row.method;
        cell.dataset.sort = row.method;
      } else if (name === "interval") { put(cell, row.low, row.low === null ? "" : `${number(row.low)} to ${number(row.high)}`);
      } else if (name === "versus") { put(cell, row.versus ? row.versus[0] : null, row.versus ? `${signed(row.versus[0])} (${signed(row.versus[1])} to ${signed(row.versus[2])})` : "");
      } else if (name === "best") { put(cell, row.best, row.best === null ? "" : `${number(row.best)} (k = ${row.k})`);
      } else if (name === "conditions") {
        const button = cell.appendChild(document.createElement("button"));
        button.type = "button"; button.textContent = "Show";
        button.setAttribute("aria-label", `Conditions of ${row.method} on ${row.column}`);
        button.addEventListener("click", () => explain(row));
      } else if (typeof row[name] === "number" || row[name] === null) { put(cell, row[name], ["rank", "seeds"].includes(name) ? String(row[name] ?? "") : number(row[name]));
      } else cell.textContent = row[name];
    }
    return tr;
  }

  function put(cell, value, text) {
    cell.className = "number"; cell.dataset.sort = value ?? ""; cell.textContent = text;
  }

  function explain(row) {
    const dialog = document.getElementById("conditions");
    dialog.querySelector("h3").textContent = `${row.method} on ${row.domain}`;
    dialog.querySelector("ul").replaceChildren(...row.texts.map((text) => { const item = document.createElement("li"); item.textContent = text; return item; }));
    dialog.showModal();
  }

  // Sorting by keyboard: the library listens to clicks.
  function makeSortable(th) {
    th.tabIndex = 0;
    th.addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); th.click(); } });
  }

  return {setUp, show, makeSortable};
})();
