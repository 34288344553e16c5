// The page of one wire.  What is drawn comes over one WebSocket, what is asked goes over the same: it ends with the page.
"use strict";

const KEPT_s = 120; // of time that is drawn
const TRAIL_s = 40; // of the loop
const MOST_ROWS = 3000; // kept; the memory of the page does not grow
const DRAW_PERIOD_ms = 100;
const SETPOINT_PERIOD_ms = 100;
const RETRY_ms = 1000;
const WAVE_PERIOD_ms = 50; // between setpoints of a sine
const SHORTEST_WAVE_s = 0.5;
const MOST_UNANSWERED = 10; // setpoints of a wave; with more it ends
const SHORT_px = 900; // a window that is no higher has lower plots, so that plots and commands are seen at once
const LEVELS = ["good", "warn", "bad", "warn"];
const DEGREES = 180 / Math.PI;
// Columns as they are drawn: factor to the unit shown.
const FACTORS = {
  setpoint_m: 1e3, limited_setpoint_m: 1e3, shortest_m: 1e3, longest_m: 1e3, displacement_estimate_m: 1e3, uncertainty_m: 1e3, displacement_m: 1e3,
  current_A: 1e3, current_limit_A: 1e3, stress_Pa: 1e-6, power_W: 1e3,
  asked_angle_rad: DEGREES, reference_rad: DEGREES, angle_rad: DEGREES, uncertainty_rad: DEGREES, torque_Nm: 1e3,
};
// What there is to see of a wire, and of a joint that two wires turn.  An axis spans no less than `least`: what is at rest is a
// line, and its noise no picture.
const WIRE = {
  asked: "setpoint_m", followed: "limited_setpoint_m", measured: "displacement_m", at: "displacement_estimate_m", half: "uncertainty_m",
  unit: "mm", label: "displacement [mm]", digits: 3, least: 0.2, amplitude: 0.2,
  range: (parameters) => parameters.range_m?.map((m) => m * 1e3) ?? null,
  question: (mm) => ["setpoint", { position_m: mm * 1e-3 }],
  below: [
    { column: "current_A", words: "current [mA]", colour: "good" }, { column: "current_limit_A", words: "limit [mA]", colour: "limit", dash: [3, 3] },
    { column: "temperature_C", words: "temperature [°C]", colour: "bad", right: true },
  ],
  belowDigits: 1, leastBelow: { left: 20, right: 10 },
  shown: [
    ["displacement_estimate_m", "estimate", "mm", 3], ["uncertainty_m", "± (95 %)", "mm", 3], ["setpoint_m", "setpoint", "mm", 3],
    ["displacement_m", "reference", "mm", 3], ["current_A", "current", "mA", 1], ["temperature_C", "temperature", "°C", 1],
    ["shortest_m", "can go from", "mm", 3], ["longest_m", "can go to", "mm", 3],
    ["load_N", "load", "N", 3], ["stress_Pa", "stress", "MPa", 1], ["resistance_Ohm", "resistance", "Ω", 3],
    ["power_W", "power", "mW", 1],
  ],
};
const JOINT = {
  asked: "asked_angle_rad", followed: "reference_rad", measured: "none", at: "angle_rad", half: "uncertainty_rad",
  unit: "°", label: "angle [°]", digits: 2, least: 2, amplitude: 5,
  range: (parameters) => parameters.angle_range_rad?.map((rad) => rad * DEGREES) ?? null,
  question: (degrees) => ["angle", { angle_rad: degrees / DEGREES }],
  below: [
    { column: "cocontraction_N", words: "co-contraction [N]", colour: "good", axis: "tension [N]" }, { column: "asked_cocontraction_N", words: "asked [N]", colour: "limit", dash: [3, 3] },
    { column: "torque_Nm", words: "torque [mN·m]", colour: "bad", right: true },
  ],
  belowDigits: 2, leastBelow: { left: 0.5, right: 1 },
  shown: [
    ["angle_rad", "angle", "°", 2], ["uncertainty_rad", "± (95 %)", "°", 2], ["asked_angle_rad", "asked", "°", 2], ["reference_rad", "followed", "°", 2],
    ["cocontraction_N", "co-contraction", "N", 3], ["asked_cocontraction_N", "asked", "N", 3], ["torque_Nm", "torque", "mN·m", 2],
  ],
};

const $ = (id) => document.getElementById(id);

function el(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

// --- the token: in the address that the command prints, then kept by this tab alone ------------------

function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given) {
    sessionStorage.setItem("sma-token", given);
    history.replaceState(null, "", location.pathname + location.search);
  }
  return given || sessionStorage.getItem("sma-token") || "";
}

const token = takeToken();

// --- colours: the page's own, light or dark as the system is ------------------------------------------

const theme = {};
const darkness = matchMedia("(prefers-color-scheme: dark)");

function takeTheme() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["ink", "soft", "grid", "setpoint", "limited", "band", "band-fill", "blue", "good", "limit", "bad"]) theme[name] = style.getPropertyValue(`--${name}`).trim();
}

takeTheme();

// --- rows --------------------------------------------------------------------------------------------

class Rows {
  constructor() {
    this.columns = {};
  }

  column(name) {
    return (this.columns[name] ??= []);
  }

  get times() {
    return this.column("at_s");
  }

  push(names, row) {
    names.forEach((name, i) => this.column(name).push(row[i] === null ? null : row[i] * (FACTORS[name] ?? 1)));
    const at = this.last(kind.at), half = this.last(kind.half);
    const known = at !== null && half !== null;
    this.column("high").push(known ? at + half : null);
    this.column("low").push(known ? at - half : null);
    this.column("none").push(null);
    if (this.times.length > MOST_ROWS) {
      const gone = this.times.findIndex((t) => t > row[0] - KEPT_s);
      for (const values of Object.values(this.columns)) values.splice(0, Math.max(gone, MOST_ROWS / 10));
    }
  }

  static ofLog(columns) {
    const rows = new Rows();
    const n = columns.at_s.length;
    for (const [name, values] of Object.entries(columns)) {
      rows.columns[name] = values.map((v) => (v === null ? null : v * (FACTORS[name] ?? 1)));
    }
    for (const name of ["none", "setpoint_m", "limited_setpoint_m", "high", "low", "temperature_C", "current_limit_A", "displacement_m"]) {
      rows.columns[name] ??= new Array(n).fill(null);
    }
    return rows;
  }

  last(name) {
    return this.column(name).at(-1) ?? null;
  }
}

let kind = WIRE;
let range = null; // [from, to], where it may be asked to go, in the unit shown
let dirty = false; // something is to be drawn
const live = new Rows();
let shownLog = null; // Rows of a dropped log, while it is shown
let names = [];
let qualityWords = {};
let curves = null;
let model = { full_stroke_m: null };

// --- over time ---------------------------------------------------------------------------------------

function clock(value) {
  return shownLog ? `${value} s` : new Date(value * 1000).toTimeString().slice(0, 8);
}

function line(label, colour, more = {}, digits = 3) {
  return { label, stroke: () => theme[colour], width: 1.5, spanGaps: false, points: { show: false }, value: (_, v) => (v == null ? "–" : v.toFixed(digits)), ...more };
}

function noLessThan(span) {
  return (made, low, high, scale) => {
    if (grabbed) return [made.scales[scale].min, made.scales[scale].max]; // the ground does not move under who drags
    if (low === null || high === null) return [0, span];
    const more = Math.max(span - (high - low), 0.1 * (high - low)) / 2;
    return [low - more, high + more];
  };
}

let zoom = null; // {min, max} of time, kept while data arrive
let selecting = false; // the mouse is down on a plot: nothing moves under it
let grabbed = null; // the setpoint's grip, while it is dragged

function zoomTo(wanted) {
  zoom = wanted;
  $("zoom").hidden = !wanted;
  redraw();
}

$("zoom").onclick = () => zoomTo(null);
addEventListener("mouseup", () => { selecting = false; });

function plot(place, height, spans, columns, series, axes, bands = []) {
  const ranges = Object.fromEntries(Object.entries(spans).map(([name, span]) => [name, { range: noLessThan(span) }]));
  const coloured = axes.map((axis) => ({ stroke: () => theme.ink, ...axis, grid: { stroke: () => theme.grid, ...axis.grid }, ticks: { stroke: () => theme.grid, ...axis.ticks } }));
  const made = new uPlot(
    {
      width: 300, height, series: [{ label: "time", value: (_, v) => (v == null ? "–" : clock(v)) }, ...series], axes: coloured, bands,
      scales: { x: { time: false }, ...ranges },
      cursor: { sync: { key: "time" }, drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => () => zoomTo(null) } },
      hooks: {
        setSelect: [(u) => {
          const { left, width } = u.select;
          if (width > 0) zoomTo({ min: u.posToVal(left, "x"), max: u.posToVal(left + width, "x") });
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        }],
      },
    },
    [[], ...columns.map(() => [])],
    place,
  );
  made.over.addEventListener("mousedown", () => { selecting = true; });
  // Looked at with every drawing: a window tells of its new size before it has it.
  const fit = () => {
    const size = { width: Math.max(place.clientWidth, 200), height: height * (innerHeight <= SHORT_px ? 0.75 : 1) };
    if (made.width !== size.width || made.height !== size.height) made.setSize(size);
  };
  new ResizeObserver(redraw).observe(place);
  addEventListener("resize", redraw);
  made.show = (rows) => {
    if (selecting) return;
    fit();
    made.setData([rows.times, ...columns.map((name) => rows.column(name))], false);
    const end = rows.last("at_s") ?? 1;
    const start = shownLog ? rows.times[0] : Math.max(rows.times[0] ?? 0, end - KEPT_s);
    if (zoom && zoom.max < start) zoomTo(null); // what was looked at is gone
    made.setScale("x", zoom ?? { min: start, max: Math.max(end, start + 1) });
    if (made.cursor.left < 0) made.setLegend({ idx: rows.times.length - 1 }, false); // the values of now, where nobody points at others
  };
  return made;
}

const timeAxis = { values: (_, splits) => splits.map(clock), space: 90 };
const beside = { size: 50, labelSize: 18, space: 30 };

let positionPlot, heatPlot;

function makePlots() {
  for (const made of [positionPlot, heatPlot]) made?.destroy();
  const { digits, below } = kind;
  const off = (u, v, _, i) => (v == null ? "–" : `±${((v - u.data[4][i]) / 2).toFixed(digits)}`);
  positionPlot = plot(
    $("position-plot"), 300, { y: kind.least },
    [kind.asked, kind.followed, "high", "low", kind.measured, kind.at],
    [
      line("setpoint", "setpoint", { dash: [6, 4] }, digits), line("rate limited", "limited", { class: "fewer" }, digits),
      line("95 %", "band", { width: 1, value: off }), line("−95 %", "band", { width: 1, class: "unlisted" }),
      line("reference", "ink", { class: kind.measured === "none" ? "unlisted" : null }, digits), line("estimate", "blue", { width: 2 }, digits),
    ],
    // An empty axis on the right, for the setpoint's grip, and so that the two plots stand exactly over each other.
    [timeAxis, { ...beside, label: kind.label }, { ...beside, side: 1, label: " ", values: (_, s) => s.map(() => ""), grid: { show: false }, ticks: { show: false } }],
    [{ series: [3, 4], fill: () => theme["band-fill"] }],
  );
  heatPlot = plot(
    $("heat-plot"), 200, { y: kind.leastBelow.left, right: kind.leastBelow.right },
    below.map(({ column }) => column),
    below.map(({ words, colour, dash, right }) => line(words, colour, { dash, scale: right ? "right" : "y" }, kind.belowDigits)),
    [timeAxis, { ...beside, label: below[0].axis ?? below[0].words }, { ...beside, scale: "right", side: 1, label: below.at(-1).words, grid: { show: false } }],
  );
}

// A wire's page becomes a joint's, or the other way round, as soon as the node has said what it is.
function setKind(wanted) {
  if (kind === wanted) return;
  kind = wanted;
  live.columns = {};
  $("amplitude").value = kind.amplitude;
  for (const unit of document.querySelectorAll(".unit")) unit.textContent = kind.unit;
  for (const id of ["loop-section", "drop"]) $(id).hidden = kind === JOINT;
  makePlots();
  makeValues();
}

// --- the setpoint's grip, beside the plot of position --------------------------------------------------

function showGrip() {
  const grip = $("grip"), over = positionPlot.over;
  const mm = grabbed ? grabbed.mm : live.last(kind.asked) ?? live.last(kind.at);
  grip.hidden = shownLog !== null || mm === null;
  grip.disabled = !range;
  if (grip.hidden) return;
  const y = Math.min(Math.max(positionPlot.valToPos(mm, "y"), 0), over.clientHeight);
  const at = over.getBoundingClientRect(), place = $("position-plot").getBoundingClientRect();
  grip.style.left = `${at.right - place.left + 4}px`;
  grip.style.top = `${at.top - place.top + y}px`;
  grip.textContent = mm.toFixed(kind.digits);
}

$("grip").onpointerdown = (event) => {
  if (!range || event.button !== 0) return;
  $("grip").setPointerCapture(event.pointerId);
  const mm = live.last(kind.asked) ?? live.last(kind.at);
  grabbed = { mm, y: event.clientY, from: positionPlot.valToPos(mm, "y") };
};
$("grip").onpointermove = (event) => {
  if (!grabbed) return;
  const [low, high] = range;
  const mm = Math.min(Math.max(positionPlot.posToVal(grabbed.from + event.clientY - grabbed.y, "y"), low), high);
  if (mm === grabbed.mm) return;
  grabbed.mm = mm;
  showGrip();
  sendSetpoint(mm);
};
$("grip").onpointerup = $("grip").onpointercancel = () => { grabbed = null; redraw(); };

// --- resistance and displacement ---------------------------------------------------------------------

function ticks(low, high, wanted) {
  const raw = (high - low) / wanted;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= raw);
  const out = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) out.push(Number(v.toPrecision(6)));
  return out;
}

function bounds(values, margin) {
  let low = Infinity, high = -Infinity;
  for (const v of values) {
    if (v !== null && v < low) low = v;
    if (v !== null && v > high) high = v;
  }
  if (!(low <= high)) return [0, 1];
  const extra = margin * (high - low) || 0.5;
  return [low - extra, high + extra];
}

function drawLoop(rows) {
  const canvas = $("loop");
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, width, height);
  const n = rows.times.length;
  const resistance = rows.column("resistance_Ohm"), estimate = rows.column("displacement_estimate_m");
  let first = 0;
  if (!shownLog) while (first < n && rows.times[first] < rows.times[n - 1] - TRAIL_s) first++;
  const drawn = curves ? [curves.resistance_Ohm, [...curves.heating_m, ...curves.cooling_m].map((v) => v * 1e3)] : [[], []];
  const [x0, x1] = bounds([...drawn[0], ...resistance.slice(first)], 0.05);
  const stroke = model.full_stroke_m ? [0, model.full_stroke_m * 1e3] : [];
  const [y0, y1] = bounds([...stroke, ...estimate.slice(first)], 0.05);
  const X = (v) => 52 + ((v - x0) / (x1 - x0)) * (width - 62), Y = (v) => height - 34 - ((v - y0) / (y1 - y0)) * (height - 44);
  g.font = "12px system-ui, sans-serif";
  g.strokeStyle = theme.grid;
  g.fillStyle = theme.soft;
  g.lineWidth = 1;
  g.textAlign = "center";
  for (const v of ticks(x0, x1, 6)) { segment(g, X(v), Y(y0), X(v), Y(y1)); g.fillText(v, X(v), height - 20); }
  g.textAlign = "right";
  for (const v of ticks(y0, y1, 5)) { segment(g, X(x0), Y(v), X(x1), Y(v)); g.fillText(v, 48, Y(v) + 4); }
  g.textAlign = "center";
  g.fillText("resistance [Ω]", width / 2, height - 5);
  g.save();
  g.translate(12, height / 2);
  g.rotate(-Math.PI / 2);
  g.fillText("displacement [mm]", 0, 0);
  g.restore();
  g.save();
  g.beginPath();
  g.rect(52, 0, width - 62, height - 34);
  g.clip();
  if (curves) {
    path(g, curves.resistance_Ohm, curves.heating_m, 0, 1e3, X, Y, theme.bad);
    path(g, curves.resistance_Ohm, curves.cooling_m, 0, 1e3, X, Y, theme.blue);
    g.textAlign = "left";
    g.fillStyle = theme.bad; g.fillText("heating asymptote", 60, 16);
    g.fillStyle = theme.blue; g.fillText("cooling asymptote", 60, 32);
    g.fillStyle = theme.soft; g.fillText(`at ${(curves.stress_Pa * 1e-6).toFixed(1)} MPa`, 60, 48);
  }
  path(g, resistance, estimate, first, 1, X, Y, theme.soft);
  if (shownLog) path(g, resistance, rows.column("displacement_m"), 0, 1, X, Y, theme.setpoint);
  const R = rows.last("resistance_Ohm"), d = rows.last("displacement_estimate_m");
  if (R !== null && d !== null && !shownLog) {
    g.fillStyle = theme.setpoint;
    g.beginPath();
    g.arc(X(R), Y(d), 6, 0, 2 * Math.PI);
    g.fill();
  }
  g.restore();
  const known = R !== null && d !== null;
  $("point").textContent = shownLog ? "orange: measured; grey: estimate" : known ? `R ${R.toFixed(3)} Ω, δ ${d.toFixed(3)} mm` : "the position is not known";
}

function segment(g, x0, y0, x1, y1) {
  g.beginPath();
  g.moveTo(x0, y0);
  g.lineTo(x1, y1);
  g.stroke();
}

function path(g, xs, ys, first, factor, X, Y, colour) {
  g.strokeStyle = colour;
  g.lineWidth = 1.5;
  g.beginPath();
  let down = false;
  for (let i = first; i < xs.length; i++) {
    if (xs[i] === null || ys[i] === null) { down = false; continue; }
    if (down) g.lineTo(X(xs[i]), Y(ys[i] * factor));
    else g.moveTo(X(xs[i]), Y(ys[i] * factor));
    down = true;
  }
  g.stroke();
}

// --- drawing -----------------------------------------------------------------------------------------

let drawn_ms = 0;

function draw(now_ms) {
  if (now_ms - drawn_ms < DRAW_PERIOD_ms) { requestAnimationFrame(draw); return; }
  drawn_ms = now_ms;
  dirty = false;
  const rows = shownLog ?? live;
  positionPlot.show(rows);
  heatPlot.show(rows);
  drawLoop(rows);
  showGrip();
  showValues();
  showError();
}

function redraw() {
  if (!dirty) { dirty = true; requestAnimationFrame(draw); }
}

let valueCells = [];

function makeValues() {
  $("values").replaceChildren();
  valueCells = kind.shown.map(([name, words, unit, digits]) => {
    const cell = el("td");
    $("values").append(el("tr", {}, el("td", { textContent: words }), cell));
    return () => { const v = live.last(name); cell.textContent = v === null ? "–" : `${v.toFixed(digits)} ${unit}`; };
  });
}

function showValues() {
  for (const show of valueCells) show();
  const quality = live.last("quality");
  $("quality").textContent = quality === null ? "–" : qualityWords[quality] ?? `quality ${quality}`;
  $("quality").className = quality === 0 ? "good" : quality === 4 ? "bad" : "warn";
  const asked = live.last(kind.asked) ?? live.last(kind.at);
  if (!touched && !grabbed && asked !== null) { $("setpoint").value = asked; $("setpoint-mm").value = asked.toFixed(kind.digits); }
}

// --- state, health -----------------------------------------------------------------------------------

const diagnosticItems = new Map();
let offered = "";

function showState(state) {
  silent(!state.present);
  const status = state.status;
  showTabs(state.tabs);
  const words = !state.present ? "no word from the node: it is not there, or busy with a self-test (it is looked for)" : status ? status.message : "no status yet";
  $("status").textContent = words;
  $("status").className = !state.present ? "bad" : status ? LEVELS[status.level] : "";
  document.title = `${$("node").textContent}: ${words}`;
  $("mode").textContent = state.present && status ? status.mode : "–";
  if (!moves()) endWave("the wire is not driven any more");
  const fault = state.present && status ? status.fault : null;
  $("fault").hidden = !fault;
  $("fault").textContent = fault ? `Fault ${fault.name}: ${fault.words}. ${fault.advice}` : "";
  $("limits").replaceChildren(...(state.present && status ? status.limits : []).map((l) => el("li", { className: "warn", textContent: `Limit ${l.name}: ${l.words}. ${l.advice}` })));
  for (const said of state.diagnostics) {
    if (!diagnosticItems.has(said.name)) {
      if (!diagnosticItems.size) $("diagnostics").replaceChildren();
      const head = el("summary"), table = el("tbody");
      $("diagnostics").append(el("li", {}, el("details", {}, head, el("table", {}, table))));
      diagnosticItems.set(said.name, { head, table });
    }
    const { head, table } = diagnosticItems.get(said.name);
    head.textContent = `${said.name}: ${said.message}`;
    head.className = LEVELS[said.level];
    table.replaceChildren(...Object.entries(said.values).map(([k, v]) => el("tr", {}, el("td", { textContent: k }), el("td", { textContent: v }))));
  }
  if (offered !== state.services.join()) {
    offered = state.services.join();
    $("services").replaceChildren(...state.services.map((name) => sureButton(name.replaceAll("_", " "), () => ask("trigger", { name }))));
  }
}

// Of several nodes a tab for each, coloured as its state is: grey where it is silent.
function showTabs(tabs) {
  $("tabs").hidden = tabs.length < 2;
  $("tabs").replaceChildren(...tabs.map(([name, level]) => {
    const link = el("a", { textContent: name, href: `/?node=${encodeURIComponent(name)}#token=${token}`, className: level === null ? "small" : LEVELS[level] });
    if (name === $("node").textContent) link.ariaCurrent = "page";
    return link;
  }));
}

function silent(yes) {
  document.body.classList.toggle("silent", yes);
}

// A button that wants to be pressed twice: what it does cannot be taken back, and a dialog would cover the stop.
function sureButton(words, act) {
  const button = el("button", { type: "button", textContent: words });
  let timer = 0;
  const rest = () => { clearTimeout(timer); timer = 0; button.textContent = words; button.className = ""; };
  button.onclick = async () => {
    if (!timer) {
      button.textContent = `${words}? press again`;
      button.className = "sure";
      timer = setTimeout(rest, 3000);
      return;
    }
    rest();
    button.disabled = true;
    await act();
    button.disabled = false;
  };
  return button;
}

// --- parameters --------------------------------------------------------------------------------------

const gains = new Map();

// From a slider's 0…1 to the declared range: by decades where it spans several, for gains differ by factors.
function scaleOf([low, high]) {
  const decades = low >= 0 ? Math.min(6, Math.log10(high / Math.max(low, high * 1e-6))) : 0;
  if (decades < 2.5) return { value: (s) => low + s * (high - low), place: (v) => (v - low) / (high - low) };
  const most = 10 ** decades - 1;
  return {
    value: (s) => low + ((10 ** (decades * s) - 1) / most) * (high - low),
    place: (v) => Math.log10(1 + ((v - low) / (high - low)) * most) / decades,
  };
}

function gainRow(name, declared) {
  const number = typeof declared.value === "number";
  const label = el("label", { textContent: name.replace("controller.", ""), title: declared.description });
  const field = declared.choices.length
    ? el("select", {}, ...declared.choices.map((c) => el("option", { textContent: c })))
    : el("input", { type: "text", inputMode: number ? "decimal" : "text", title: declared.description });
  field.name = name;
  label.htmlFor = field.id = `field-${name}`;
  const answer = el("span", { className: "answer" });
  const scale = number && declared.range ? scaleOf(declared.range) : null;
  const slider = scale ? el("input", { type: "range", min: 0, max: 1, step: "any", title: `${declared.description}: ${declared.range[0]} … ${declared.range[1]}` }) : el("span");
  slider.setAttribute("aria-label", name);
  const row = { declared, show, shown: null };

  function show(value) {
    if (row.shown === value) return;
    row.shown = value;
    field.value = String(value);
    if (scale) slider.value = scale.place(value);
  }

  async function send(text) {
    // What is no number goes as text: the node says what it wants instead.
    const value = typeof declared.value === "boolean" ? text === "true" : number && text.trim() !== "" && isFinite(text) ? Number(text) : text;
    const { ok, sentence } = await ask("parameter", { name, value });
    answer.textContent = sentence;
    answer.className = `answer ${ok ? "good" : "bad"}`;
    if (!ok) { row.shown = null; show(row.declared.value); }
  }

  const rounded = () => { const v = scale.value(Number(slider.value)); return declared.whole ? Math.round(v) : Number(v.toPrecision(3)); };
  if (scale) {
    slider.oninput = () => (field.value = String(rounded()));
    slider.onchange = () => send(String(rounded()));
  }
  field.onchange = () => send(field.value);
  row.element = el("div", { className: "gain" }, label, slider, field, answer);
  return row;
}

function showParameters(parameters) {
  model = parameters;
  range = (parameters.angle_range_rad ? JOINT : WIRE).range(parameters);
  setKind(parameters.angle_range_rad ? JOINT : WIRE);
  $("model-note").textContent = parameters.note;
  if (!parameters.range_m) curves = null;
  const known = [...gains.keys()].join(), given = Object.keys(parameters.live).sort();
  if (known !== given.join()) {
    gains.clear();
    $("gains").replaceChildren();
    $("others").replaceChildren();
    for (const name of given) {
      const row = gainRow(name, parameters.live[name]);
      gains.set(name, row);
      $(name.startsWith("controller.") || kind === JOINT ? "gains" : "others").append(row.element);
    }
  }
  for (const [name, row] of gains) {
    row.declared = parameters.live[name];
    row.show(row.declared.value);
  }
  for (const id of ["setpoint", "setpoint-mm", "setpoint-send", "generate"]) $(id).disabled = !range;
  if (range) [$("setpoint").min, $("setpoint").max] = range;
  $("range").textContent = range ? `${range[0].toFixed(2)} … ${range[1].toFixed(2)} ${kind.unit}` : "";
  $("save").disabled = !parameters.file || !given.length || kind === JOINT;
  $("save-note").textContent = kind === JOINT ? "a joint's are yours to write into its file" : parameters.file ? `of ${parameters.file}` : "sma-actuator view --config FILE can save them there";
}

// --- asking ------------------------------------------------------------------------------------------

let socket = null, number = 0;
const asked = new Map();

function say(ok, sentence) {
  $("said").prepend(el("li", { className: ok ? "good" : "bad", textContent: sentence }));
  while ($("said").children.length > 6) $("said").lastChild.remove();
}

// The answer of the node, {ok, sentence}; it is shown as well, of what is asked often (quiet) only where it is no.
function ask(what, more = {}, quiet = false) {
  return new Promise((resolve) => {
    const done = (answer) => { if (!quiet || !answer.ok) say(answer.ok, answer.sentence); resolve(answer); };
    if (!socket || socket.readyState !== WebSocket.OPEN) {
      done({ ok: false, sentence: `${what}: not asked, there is no connection to sma-actuator view` });
      return;
    }
    number += 1;
    asked.set(number, done);
    socket.send(JSON.stringify({ id: number, do: what, ...more }));
  });
}

function stop() {
  endWave("");
  clearTimeout(later);
  ask("stop");
}

$("stop").onclick = stop;
// Before whatever has the focus gets it: no button is pressed by it, no field takes a blank.
addEventListener("keydown", (event) => {
  if (event.code !== "Space") return;
  event.preventDefault();
  event.stopPropagation();
  if (!event.repeat) stop();
}, true);
addEventListener("keyup", (event) => { if (event.code === "Space") event.preventDefault(); }, true);
$("save").onclick = () => ask("save");
$("enable").onclick = () => ask("enable");
$("disable").onclick = () => { endWave(""); ask("disable"); };

let touched = false, sent_ms = 0, later = 0;

function sendSetpoint(mm) {
  endWave("the setpoint is yours again");
  clearTimeout(later);
  const wait = sent_ms + SETPOINT_PERIOD_ms - performance.now();
  if (wait > 0) { later = setTimeout(() => sendSetpoint(mm), wait); return; }
  sent_ms = performance.now();
  ask(...kind.question(mm));
}

$("setpoint").oninput = () => { touched = true; $("setpoint-mm").value = Number($("setpoint").value).toFixed(kind.digits); sendSetpoint(Number($("setpoint").value)); };
$("setpoint").onchange = () => { touched = false; };
$("setpoint-mm").oninput = () => { touched = true; }; // what is typed stays until it is sent
$("setpoint-send").onclick = () => { sendSetpoint(Number($("setpoint-mm").value)); touched = false; };
$("setpoint-mm").onkeydown = (event) => { if (event.key === "Enter") $("setpoint-send").click(); };

// --- steps and sines -----------------------------------------------------------------------------------

let wave = null;

function beginWave() {
  const amplitude = Number($("amplitude").value), period = Number($("period").value);
  const centre = live.last(kind.asked) ?? live.last(kind.at);
  const [low, high] = range;
  const refusal = !moves() ? "not started: enable the wire first"
    : !(amplitude > 0) ? "not started: the amplitude is a number above 0"
    : !(period >= SHORTEST_WAVE_s) ? `not started: it takes ${SHORTEST_WAVE_s} s or longer`
    : centre - amplitude < low || centre + amplitude > high ? `not started: ±${amplitude} ${kind.unit} around ${centre.toFixed(kind.digits)} is more than ${low.toFixed(kind.digits)} … ${high.toFixed(kind.digits)} ${kind.unit}`
    : "";
  if (refusal) { say(false, refusal); return; }
  clearTimeout(later);
  wave = { sine: $("wave").value === "sine", amplitude, period, centre, began_ms: performance.now(), began_s: live.last("at_s"), sent: NaN, unanswered: 0, timer: setInterval(nextOfWave, WAVE_PERIOD_ms) };
  $("generate").textContent = "end";
  nextOfWave();
}

async function nextOfWave() {
  const mine = wave;
  const phase = ((performance.now() - mine.began_ms) * 1e-3) / mine.period;
  const mm = mine.centre + mine.amplitude * (mine.sine ? Math.sin(2 * Math.PI * phase) : phase % 1 < 0.5 ? 1 : -1);
  if (mm === mine.sent) return;
  if (mine.unanswered >= MOST_UNANSWERED) { endWave("the answers come too late"); return; }
  mine.sent = mm;
  mine.unanswered += 1;
  const { ok } = await ask(...kind.question(mm), true);
  mine.unanswered -= 1;
  if (!ok && wave === mine) endWave("a setpoint was refused");
}

function endWave(why) {
  if (!wave) return;
  clearInterval(wave.timer);
  wave = null;
  $("generate").textContent = "start";
  say(!why, `the wave has ended${why && ": "}${why}`);
}

// What the wire is off by, over the last whole period; while there is a wave, and of the last one.
function showError() {
  if (!wave || shownLog) return;
  const times = live.times, end = live.last("at_s");
  const start = Math.max(wave.began_s, end - wave.period);
  let n = 0, sum = 0, worst = 0;
  for (let i = times.length - 1; i >= 0 && times[i] > start; i--) {
    const at = live.column(kind.at)[i], asked = live.column(kind.asked)[i];
    if (at === null || asked === null) continue;
    const off = Math.abs(at - asked);
    n += 1;
    sum += off;
    worst = Math.max(worst, off);
  }
  if (n) $("error").textContent = `error over the last ${(end - start).toFixed(1)} s: mean ${(sum / n).toFixed(kind.digits)} ${kind.unit}, worst ${worst.toFixed(kind.digits)} ${kind.unit}`;
}

const moves = () => ["hold", "tracking"].includes($("mode").textContent);

$("generate").onclick = () => (wave ? endWave("ended by hand") : beginWave());
addEventListener("visibilitychange", () => { if (document.hidden) endWave("the page is hidden"); });

// --- the connection ----------------------------------------------------------------------------------

const takers = {
  hello: (hello) => { $("node").textContent = hello.node; names = hello.columns; qualityWords = hello.quality; },
  state: showState,
  parameters: showParameters,
  curves: (given) => { curves = given; redraw(); },
  rows: (rows) => { for (const row of rows) live.push(names, row); redraw(); },
  log: showLog,
  answer: (answer) => {
    const done = asked.get(answer.id) ?? ((a) => say(a.ok, a.sentence));
    asked.delete(answer.id);
    done(answer);
  },
};

function banner(text) {
  $("banner").hidden = !text;
  $("banner").textContent = text;
}

function connect() {
  if (!token) {
    banner("Open the address that sma-actuator view prints: it holds the token without which nothing is shown or done.");
    return;
  }
  socket = new WebSocket(`ws://${location.host}/live${location.search}`, ["sma-view", `token.${token}`]);
  socket.onopen = () => banner("");
  socket.onmessage = (event) => {
    for (const [kind, content] of Object.entries(JSON.parse(event.data))) takers[kind]?.(content);
  };
  socket.onclose = () => {
    endWave("there is no connection");
    silent(true);
    banner("No connection to sma-actuator view: nothing here is of now, and STOP cannot reach the node. If the command was started anew, open the address that it prints.");
    for (const done of asked.values()) done({ ok: false, sentence: "the connection ended before the answer" });
    asked.clear();
    setTimeout(connect, RETRY_ms);
  };
}

const ofThisNode = location.search.slice(1);

// --- logs --------------------------------------------------------------------------------------------

function showLog(log) {
  const came = log && $("log").hidden;
  zoomTo(null);
  shownLog = log && log.columns ? Rows.ofLog(log.columns) : null;
  $("log").hidden = !log;
  if (log) {
    $("log-name").textContent = log.name;
    $("log-words").textContent = log.words;
    $("log-trace").textContent = log.trace ?? "";
    $("log-report").hidden = !log.report;
    if (log.report) $("log-report").href = log.report;
    if (came) $("log").scrollIntoView({ block: "nearest" });
  }
  redraw();
}

async function dropLog(file) {
  say(true, `sending ${file.name} …`);
  try {
    const response = await fetch(`/log?${ofThisNode}&name=${encodeURIComponent(file.name)}`, {
      method: "POST", body: file, headers: { Authorization: `Bearer ${token}` },
    });
    if (!response.ok) say(false, await response.text());
  } catch (error) {
    say(false, `${file.name} was not sent: ${error.message}`);
  }
}

async function downloadRecording() {
  try {
    const response = await fetch(`/recording?${ofThisNode}`, { method: "POST", headers: { Authorization: `Bearer ${token}` } });
    if (!response.ok) { say(false, await response.text()); return; }
    const link = el("a", { href: URL.createObjectURL(await response.blob()), download: response.headers.get("Content-Disposition").match(/filename="(.+)"/)[1] });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    say(true, `${link.download} is with your downloads; sma-actuator check-log reads it`);
  } catch (error) {
    say(false, `nothing was downloaded: ${error.message}`);
  }
}

$("record").onclick = downloadRecording;
$("log-close").onclick = () => { showLog(null); ask("forget_log"); };
$("file").onchange = () => { if ($("file").files.length) dropLog($("file").files[0]); };
// Anywhere on the page: a file that misses the place would else be opened instead of it.
document.ondragover = (event) => { event.preventDefault(); $("drop").classList.add("over"); };
document.ondragleave = () => $("drop").classList.remove("over");
document.ondrop = (event) => {
  event.preventDefault();
  $("drop").classList.remove("over");
  if (event.dataTransfer.files.length) dropLog(event.dataTransfer.files[0]);
};

darkness.addEventListener("change", () => { takeTheme(); positionPlot.redraw(); heatPlot.redraw(); redraw(); });
makePlots();
makeValues();
redraw();
connect();
