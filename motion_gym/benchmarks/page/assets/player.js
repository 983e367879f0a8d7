"use strict";
// Plays stored scenes on a canvas. A scene of windows has 20 steps; a stream has many frames, and forecasts at each.
const Player = (() => {
  const HISTORY = 8, FUTURE = 12, STEPS_PER_SECOND = 4, FRAMES_PER_SECOND = 6, LONGEST = 6;
  let scenes, colors, onChange, parts, scene, at = 0, playing = false, last = 0, speed = 1, hidden = new Set(), view;

  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const steps = () => scene.kind === "windows" ? HISTORY + FUTURE - 1 : scene.frames.length - 1;
  const methods = () => scene.methods.filter((name) => !hidden.has(name));
  const point = (flat, i) => [flat[2 * i] / scene.scale, flat[2 * i + 1] / scene.scale];

  function setUp(place, all, colorOf, changed) {
    scenes = all; colors = colorOf; onChange = changed;
    const make = (tag, more = {}, ...children) => { const e = Object.assign(document.createElement(tag), more); e.append(...children); return e; };
    const select = make("select", {id: "scene"});
    for (const group of [...new Set(scenes.map((each) => each.group))]) {
      const options = make("optgroup", {label: group});
      scenes.forEach((each, i) => { if (each.group === group) options.append(new Option(each.title, i)); });
      select.append(options);
    }
    const button = (text, label, action) => { const b = make("button", {type: "button", textContent: text}); b.setAttribute("aria-label", label); b.title = label; b.addEventListener("click", action); return b; };
    const play = button("▶ Play", "Play or pause (space)", toggle);
    const scrub = make("input", {type: "range", min: 0, step: 1, value: 0}); scrub.setAttribute("aria-label", "Step");
    scrub.addEventListener("input", () => { pause(); go(+scrub.value); });
    const rate = make("select"); for (const value of [0.25, 0.5, 1, 2, 4]) rate.append(new Option(`${value} ×`, value, value === 1, value === 1));
    rate.setAttribute("aria-label", "Speed"); rate.addEventListener("change", () => { speed = +rate.value; });
    const canvas = make("canvas", {id: "stage"}), errors = make("canvas", {id: "errors"});
    canvas.setAttribute("role", "img"); errors.setAttribute("role", "img");
    const status = make("p", {id: "status"}); status.setAttribute("role", "status"); status.setAttribute("aria-live", "off");
    const controls = make("div", {className: "controls"}, play, button("Start", "First step", () => { pause(); go(0); }), button("−1", "One step back (left arrow)", () => { pause(); go(Math.ceil(at) - 1); }), button("+1", "One step on (right arrow)", () => { pause(); go(Math.floor(at) + 1); }), scrub, rate);
    const left = make("div", {}, make("div", {className: "controls"}, make("label", {}, "Scene", select)), canvas, controls, status, errors);
    const legend = make("fieldset", {}, make("legend", {textContent: "Methods"}));
    const gauges = make("div", {id: "gauges"}), table = make("table", {id: "scores"});
    const right = make("div", {}, legend, gauges, make("div", {className: "scroll", tabIndex: 0, role: "region", ariaLabel: "Errors in this scene"}, table));
    place.append(left, right);
    parts = {select, play, scrub, canvas, errors, status, legend, gauges, table, make};
    select.addEventListener("change", () => { pause(); onChange({scene: select.value}); open(+select.value, {}); });
    left.addEventListener("keydown", (event) => {
      if (["SELECT", "INPUT", "BUTTON"].includes(event.target.tagName) && event.key === " ") return;
      if (event.target.tagName === "SELECT" || (event.target.type === "range" && event.key !== " ")) return;
      const action = {" ": toggle, ArrowLeft: () => { pause(); go(Math.ceil(at) - 1); }, ArrowRight: () => { pause(); go(Math.floor(at) + 1); }}[event.key];
      if (action) { event.preventDefault(); action(); }
    });
    canvas.tabIndex = 0;
    canvas.addEventListener("click", toggle);
    addEventListener("resize", () => { if (scene) draw(); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (scene) draw(); });
  }

  function show(state) {
    const number = Math.min(Math.max(Math.floor(+state.scene) || 0, 0), scenes.length - 1);
    open(number, state);
  }

  function open(number, state) {
    scene = scenes[number];
    hidden = new Set((state.hide ?? "").split("|").filter(Boolean));
    parts.select.value = number; parts.scrub.max = steps();
    parts.legend.querySelectorAll("label").forEach((label) => label.remove());
    for (const name of scene.methods) {
      const box = parts.make("input", {type: "checkbox", checked: !hidden.has(name)});
      box.addEventListener("change", () => { if (box.checked) hidden.delete(name); else hidden.add(name); remember(); draw(); });
      const swatch = parts.make("span", {className: "swatch"}); swatch.style.background = colors[name];
      parts.legend.append(parts.make("label", {}, box, swatch, parts.make("span", {textContent: name})));
    }
    if (scene.image && !scene.picture) { scene.picture = new Image(); scene.picture.onload = draw; scene.picture.src = scene.image.uri; }
    view = extent();
    const start = state.step === undefined ? (scene.kind === "windows" ? HISTORY - 1 : 0) : +state.step;
    scores();
    go(Number.isFinite(start) ? start : 0);
  }

  function remember() {
    onChange({scene: parts.select.value, step: Math.round(at), hide: [...hidden].join("|")});
  }

  function go(step) {
    at = Math.min(Math.max(step, 0), steps());
    if (!playing) remember();
    draw();
  }

  function toggle() {
    if (playing) { pause(); return; }
    playing = true;
    if (at >= steps()) at = 0;
    parts.play.textContent = "⏸ Pause";
    last = performance.now();
    requestAnimationFrame(tick);
  }

  function pause() {
    if (!playing) return;
    playing = false; parts.play.textContent = "▶ Play"; remember();
  }

  function tick(now) {
    if (!playing) return;
    at += (now - last) / 1000 * speed * (scene.kind === "windows" ? STEPS_PER_SECOND : FRAMES_PER_SECOND);
    last = now;
    if (at >= steps()) { at = steps(); draw(); pause(); return; }
    draw();
    requestAnimationFrame(tick);
  }

  // Where the scene lies in its own unit: the center, and the width and height that are shown.
  function extent() {
    const xs = [], ys = [];
    const add = (flat) => { for (let i = 0; i < flat.length / 2; i++) if (flat[2 * i] !== null) { const [x, y] = point(flat, i); xs.push(x); ys.push(y); } };
    if (scene.kind === "windows") { scene.history.forEach(add); scene.future.forEach(add); for (const name of scene.methods) scene.forecasts[name].forEach((samples) => add(samples[0])); }
    else for (const frame of scene.frames) frame.xy.forEach(add);
    const range = (values) => { const low = values.reduce((a, b) => Math.min(a, b)), high = values.reduce((a, b) => Math.max(a, b)); return [low, high]; };
    const [left, right] = range(xs), [low, high] = range(ys);
    const size = Math.max(right - left, high - low, 1e-6) * 1.15;
    return {x: (left + right) / 2, y: (low + high) / 2, width: Math.max((right - left) * 1.1, size * .2), height: Math.max((high - low) * 1.1, size / LONGEST / 2), long: (right - left) > LONGEST * (high - low)};
  }

  function prepared(canvas, ratio) {
    const width = Math.max(canvas.clientWidth, 200), height = Math.round(width * ratio), density = devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * density) || canvas.height !== Math.round(height * density)) { canvas.width = Math.round(width * density); canvas.height = Math.round(height * density); canvas.style.height = `${height}px`; }
    const context = canvas.getContext("2d");
    context.setTransform(density, 0, 0, density, 0, 0);
    context.clearRect(0, 0, width, height);
    return [context, width, height];
  }

  function draw() {
    const [context, width, height] = prepared(parts.canvas, view.long ? .36 : .66);
    let sx = width / view.width, sy = height / view.height;
    if (!view.long) sx = sy = Math.min(sx, sy);
    const up = scene.down ? 1 : -1;
    const screen = ([x, y]) => [width / 2 + (x - view.x) * sx, height / 2 + up * (y - view.y) * sy];
    ground(context, screen, sx, sy);
    if (scene.kind === "windows") windows(context, screen); else stream(context, screen);
    bar(context, width, height, sx);
    curve();
    gauges();
    parts.scrub.value = Math.round(at);
    describe();
  }

  function ground(context, screen, sx, sy) {
    if (scene.picture?.complete && scene.picture.naturalWidth) {
      const {left, top, width, height} = scene.image, [x, y] = screen([left, top]);
      context.globalAlpha = .5; context.drawImage(scene.picture, x, y, width * sx, height * sy); context.globalAlpha = 1;
    }
    for (const [dashed, flat] of scene.ground ?? []) path(context, screen, flat, 0, flat.length / 2 - 1, {color: css("--line"), width: 1.5, dash: dashed ? [6, 6] : []});
  }

  // Draws points `from` to `to` of a flat list; `to` may lie between two points.
  function path(context, screen, flat, from, to, {color, width = 2, dash = [], alpha = 1, start = null}) {
    context.beginPath();
    let begun = false, before = null;
    const reach = (p) => { const [x, y] = screen(p); if (begun) context.lineTo(x, y); else context.moveTo(x, y); begun = true; before = p; };
    if (start) reach(start);
    for (let i = from; i <= Math.floor(to); i++) { if (flat[2 * i] === null || flat[2 * i] === undefined) break; reach(point(flat, i)); }
    const next = Math.floor(to) + 1, part = to - Math.floor(to);
    if (part > 0 && before && flat[2 * next] !== undefined && flat[2 * next] !== null) { const p = point(flat, next); reach([before[0] + part * (p[0] - before[0]), before[1] + part * (p[1] - before[1])]); }
    context.strokeStyle = color; context.lineWidth = width; context.globalAlpha = alpha; context.setLineDash(dash); context.lineJoin = context.lineCap = "round";
    context.stroke(); context.setLineDash([]); context.globalAlpha = 1;
    return before;
  }

  function dot(context, screen, p, color, radius = 5) {
    const [x, y] = screen(p);
    context.beginPath(); context.arc(x, y, radius, 0, 7); context.fillStyle = color; context.fill();
  }

  function windows(context, screen) {
    const text = css("--text"), future = at - (HISTORY - 1);
    scene.history.forEach((history, agent) => {
      const now = point(history, HISTORY - 1);
      if (future >= 0) for (const name of methods()) {
        const samples = scene.forecasts[name][agent];
        for (let k = samples.length - 1; k >= 0; k--) path(context, screen, samples[k], 0, FUTURE - 1, {color: colors[name], width: k ? 1 : 2.5, alpha: k ? .3 : 1, start: now});
      }
      const end = path(context, screen, history, 0, Math.min(at, HISTORY - 1), {color: css("--track"), width: 5});
      const reached = future > 0 ? path(context, screen, scene.future[agent], 0, future - 1, {color: text, width: 2.5, dash: [6, 4], start: now}) : end;
      dot(context, screen, reached ?? now, text);
    });
  }

  function stream(context, screen) {
    const text = css("--text"), i = Math.floor(at), part = at - i, frame = scene.frames[i], next = scene.frames[i + 1];
    const made = scene.frames.findIndex((f) => f.t === frame.t - FUTURE);
    frame.agent.forEach((agent, row) => {
      const flat = frame.xy[row], now = point(flat, HISTORY - 1);
      path(context, screen, flat, 0, HISTORY - 1, {color: css("--track"), width: 5});
      for (const name of methods()) path(context, screen, frame.forecasts[name][row], 0, FUTURE - 1, {color: colors[name], width: 2, start: now});
      const later = next ? next.agent.indexOf(agent) : -1;
      const p = later >= 0 ? point(next.xy[later], HISTORY - 1) : now;
      dot(context, screen, [now[0] + part * (p[0] - now[0]), now[1] + part * (p[1] - now[1])], text);
    });
    // Labels that are revealed now: the forecasts of 12 frames ago beside what happened.
    if (made >= 0) scene.frames[made].agent.forEach((agent, row) => {
      if (!frame.agent.includes(agent)) return;
      for (const name of methods()) {
        const [x, y] = screen(point(scene.frames[made].forecasts[name][row], FUTURE - 1));
        const [tx, ty] = screen(point(frame.xy[frame.agent.indexOf(agent)], HISTORY - 1));
        context.strokeStyle = colors[name]; context.lineWidth = 1.5; context.setLineDash([2, 3]);
        context.beginPath(); context.moveTo(x, y); context.lineTo(tx, ty); context.stroke(); context.setLineDash([]);
        context.beginPath(); context.arc(x, y, 4, 0, 7); context.stroke();
      }
    });
  }

  function bar(context, width, height, sx) {
    const most = width / 4 / sx, power = 10 ** Math.floor(Math.log10(most)), length = [5, 2, 1].map((f) => f * power).find((l) => l <= most);
    context.fillStyle = css("--text"); context.fillRect(12, height - 14, length * sx, 3);
    context.font = "12px system-ui"; context.fillText(`${+length.toPrecision(2)} ${scene.unit}${view.long ? " (across the road on a larger scale)" : ""}`, 12, height - 20);
  }

  // Mean error of each of the 12 steps over the agents, most likely sample.
  function errorsOf(name) {
    return Array.from({length: FUTURE}, (_, step) => {
      const errors = scene.future.flatMap((flat, agent) => {
        if (flat[2 * step] === null) return [];
        const [x, y] = point(flat, step), [fx, fy] = point(scene.forecasts[name][agent][0], step);
        return [Math.hypot(x - fx, y - fy)];
      });
      return errors.length ? errors.reduce((a, b) => a + b) / errors.length : null;
    });
  }

  function curve() {
    const [context, width, height] = prepared(parts.errors, .24), text = css("--text"), margin = 44;
    const lines = methods().map((name) => [name, scene.kind === "windows" ? errorsOf(name) : scene.errors[name]]);
    const shown = scene.kind === "windows" ? Math.max(at - (HISTORY - 1), 0) : at;
    const count = scene.kind === "windows" ? FUTURE : steps();
    const top = Math.max(...lines.flatMap(([, values]) => values.filter((v) => v !== null)), 1e-9) * 1.1;
    const x = (i) => margin + i / count * (width - margin - 10), y = (v) => height - 22 - v / top * (height - 40);
    context.strokeStyle = css("--line"); context.fillStyle = text; context.font = "11px system-ui"; context.lineWidth = 1;
    for (const part of [0, .5, 1]) { const v = part * top / 1.1; context.beginPath(); context.moveTo(margin, y(v)); context.lineTo(width - 10, y(v)); context.stroke(); context.fillText(v.toFixed(2), 8, y(v) + 4); }
    context.fillText(scene.kind === "windows" ? `error after each future step, ${scene.unit}` : `mean error of the last 50 matured forecasts, ${scene.unit}`, margin, 12);
    for (const [step, label] of scene.marks ?? []) { context.fillStyle = text; context.fillRect(x(step), 16, 1, height - 38); context.fillText(label, Math.min(x(step) + 4, width - 90), height - 6); }
    for (const [name, values] of lines) {
      context.strokeStyle = colors[name]; context.lineWidth = 2; context.beginPath();
      let begun = false;
      if (scene.kind === "windows") { context.moveTo(x(0), y(0)); begun = true; }
      values.forEach((value, i) => {
        const place = scene.kind === "windows" ? i + 1 : i;
        if (value === null || place > shown + 1e-6) return;
        if (begun) context.lineTo(x(place), y(value)); else context.moveTo(x(place), y(value));
        begun = true;
      });
      context.stroke();
    }
    context.fillStyle = text; context.fillRect(x(Math.min(shown, count)), 16, 1, height - 38);
    parts.errors.setAttribute("aria-label", `Errors over time of ${methods().join(", ")}; the table beside has them as numbers`);
  }

  function gauges() {
    if (!scene.gauges) { parts.gauges.replaceChildren(); return; }
    const frame = Math.round(at), rows = [];
    for (const [name, values] of Object.entries(scene.gauges)) {
      if (hidden.has(name)) continue;
      rows.push(parts.make("h4", {textContent: `What ${name} has learned`}));
      const bars = parts.make("div", {className: "bars"});
      for (const [gauge, series] of Object.entries(values)) {
        const value = series[frame] ?? 0, most = Math.max(...series.filter((v) => v !== null), 1e-9);
        const meter = parts.make("meter", {min: 0, max: gauge.startsWith("trust") ? 1 : most, value}); meter.setAttribute("aria-label", gauge);
        bars.append(parts.make("span", {textContent: gauge}), meter, parts.make("span", {textContent: value.toFixed(2)}));
      }
      rows.push(bars);
    }
    parts.gauges.replaceChildren(...rows);
  }

  function scores() {
    const head = parts.make("thead"), body = parts.make("tbody"), windowed = scene.kind === "windows";
    head.append(parts.make("tr", {}, ...["Method", ...(windowed ? ["ADE", "FDE"] : scene.labels)].map((t) => parts.make("th", {scope: "col", textContent: t}))));
    for (const name of scene.methods) {
      const errors = windowed ? errorsOf(name).filter((v) => v !== null) : null;
      const values = windowed ? [errors.reduce((a, b) => a + b, 0) / errors.length, errors[errors.length - 1]] : scene.labels.map((label) => scene.means[name][label]);
      body.append(parts.make("tr", {}, parts.make("th", {scope: "row", textContent: name}), ...values.map((v) => parts.make("td", {className: "number", textContent: v === null ? "" : v.toFixed(2)}))));
    }
    parts.table.replaceChildren(parts.make("caption", {textContent: `${windowed ? "Errors in this scene" : "Mean error of the matured forecasts of each part"}, ${scene.unit}`}), head, body);
  }

  function describe() {
    const windowed = scene.kind === "windows", i = Math.floor(at);
    const text = windowed
      ? `Step ${i + 1} of ${HISTORY + FUTURE}, ${((i - HISTORY + 1) * scene.dt).toFixed(1)} s from the last observed step.`
      : `Frame ${i + 1} of ${scene.frames.length}, ${(scene.frames[i].t * scene.dt).toFixed(1)} s, ${scene.labels[scene.frames[i].part]}.`;
    parts.status.textContent = text;
    parts.canvas.setAttribute("aria-label", `${scene.title}. ${text} ${windowed ? scene.history.length : scene.frames[i].agent.length} agents.`);
  }

  return {setUp, show, pause};
})();
