"use strict";
// Curves with bands of one standard deviation over seeds, drawn by uPlot when they come into view.
const Charts = (() => {
  const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const drawn = new Map();

  function setUp(charts) {
    const seen = new IntersectionObserver((entries) => {
      for (const entry of entries) if (entry.isIntersecting) { seen.unobserve(entry.target); draw(entry.target, charts[entry.target.dataset.chart]); }
    }, {rootMargin: "300px"});
    document.querySelectorAll(".chart").forEach((place) => { place.style.minHeight = "24rem"; seen.observe(place); });
    const again = () => { for (const [place, chart] of drawn) draw(place, chart); };
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
    addEventListener("resize", () => { for (const [place] of drawn) place.plot.setSize(size(place)); });
  }

  const size = (place) => ({width: Math.max(place.clientWidth, 280), height: place.clientWidth < 600 ? 260 : 380});

  function draw(place, chart) {
    const text = color("--text"), lines = color("--line");
    const data = [chart.x], series = [{label: chart.x_label}], bands = [];
    for (const line of chart.lines) {
      const bound = (sign) => line.mean.map((value, i) => value === null ? null : value + sign * line.deviation[i]);
      const at = data.length;
      data.push(line.mean, bound(1), bound(-1));
      series.push({label: line.name, stroke: line.color, dash: line.dash, width: 2, spanGaps: true, points: {show: chart.x.length < 20, size: 6},
                   value: (_, value, __, i) => value === null || i === null ? "" : `${value.toFixed(3)} ± ${line.deviation[i].toFixed(3)}`});
      for (let side = 0; side < 2; side++) series.push({stroke: "transparent", points: {show: false}, spanGaps: true, label: ""});
      bands.push({series: [at + 1, at + 2], fill: line.color + "26"});
    }
    const axis = {stroke: text, grid: {stroke: lines, width: 1}, ticks: {stroke: lines}};
    const options = {
      ...size(place), series, bands, cursor: {focus: {prox: 24}}, focus: {alpha: .25}, legend: {live: true},
      scales: {x: {time: false, distr: {linear: 1, log: 3, symlog: 4}[chart.scale], log: 2}, y: {range: (_, low, high) => [Math.min(0, low), high * 1.05]}},
      axes: [{...axis, label: chart.x_label, ...(chart.ticks.length ? {splits: () => chart.ticks, values: (_, ticks) => ticks.map(String)} : {})}, {...axis, label: chart.y_label, size: 64}],
      hooks: {draw: [(plot) => marks(plot, chart.marks, text)]},
    };
    place.replaceChildren(heading(chart.title));
    place.plot = new uPlot(options, data, place);
    place.querySelectorAll(".u-series").forEach((row, i) => {
      if (i === 0) return;
      if ((i - 1) % 3) { row.remove(); return; }
      const label = row.querySelector("th");
      label.tabIndex = 0; label.setAttribute("role", "button"); label.setAttribute("aria-label", `Show or hide ${chart.lines[(i - 1) / 3].name}`);
      label.addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); label.click(); } });
      label.addEventListener("click", () => { for (const side of [1, 2]) place.plot.setSeries(i + side, {show: place.plot.series[i].show}); });
    });
    place.append(numbers(chart));
    drawn.set(place, chart);
  }

  function marks(plot, places, text) {
    const {ctx, bbox} = plot;
    ctx.save();
    ctx.fillStyle = ctx.strokeStyle = text; ctx.font = `${11 * devicePixelRatio}px system-ui`; ctx.globalAlpha = .8;
    for (const [at, name] of places) {
      const x = plot.valToPos(at, "x", true);
      if (x < bbox.left - 1 || x > bbox.left + bbox.width) continue;
      ctx.fillRect(x, bbox.top, 1, bbox.height);
      ctx.fillText(name, x + 4, bbox.top + 12 * devicePixelRatio);
    }
    ctx.restore();
  }

  function heading(title) { const h4 = document.createElement("h4"); h4.textContent = title; return h4; }

  // The same numbers as a table, which screen readers can read.
  function numbers(chart) {
    const details = document.createElement("details");
    details.append(Object.assign(document.createElement("summary"), {textContent: `Numbers of ${chart.title}`}));
    details.addEventListener("toggle", () => {
      if (!details.open || details.querySelector("table")) return;
      const every = Math.ceil(chart.x.length / 20), columns = chart.x.map((_, i) => i).filter((i) => i % every === 0);
      const table = document.createElement("table"), head = table.createTHead().insertRow();
      for (const title of [chart.x_label, ...columns.map((i) => +chart.x[i].toPrecision(5))]) head.append(Object.assign(document.createElement("th"), {scope: "col", textContent: title}));
      const body = table.createTBody();
      for (const line of chart.lines) {
        const row = body.insertRow();
        row.append(Object.assign(document.createElement("th"), {scope: "row", textContent: line.name}));
        for (const i of columns) row.insertCell().textContent = line.mean[i] === null ? "" : `${line.mean[i].toFixed(3)} ± ${line.deviation[i].toFixed(3)}`;
      }
      const scroll = Object.assign(document.createElement("div"), {className: "scroll", tabIndex: 0});
      scroll.setAttribute("role", "region"); scroll.setAttribute("aria-label", `Numbers of ${chart.title}`);
      scroll.append(table); details.append(scroll);
    });
    return details;
  }

  return {setUp};
})();
