// Pictures that hold their data can be looked into: the wheel zooms, dragging selects, a double click shows all again.
"use strict";

const LEFT = 64, RIGHT = 12, TOP = 24, BOTTOM = 44;

function numbers(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Float32Array(bytes.buffer);
}

function ticks(low, high, wanted) {
  const rough = (high - low) / wanted, power = Math.pow(10, Math.floor(Math.log10(rough)));
  const step = [1, 2, 5, 10].map(m => m * power).find(s => s >= rough * 0.999), out = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) out.push(k * step);
  return { step, at: out };
}

function label(value, step) {
  const digits = Math.max(0, Math.min(9, -Math.floor(Math.log10(step) + 1e-9)));
  return value.toFixed(digits);
}

function zoomed([low, high], at, factor) {
  return [at + (low - at) * factor, at + (high - at) * factor];
}

// Between numbers of the data and pixels of a canvas of this size.
function scale(view, width, height) {
  const w = width - LEFT - RIGHT, h = height - TOP - BOTTOM, [x0, x1] = view.x, [y0, y1] = view.y;
  return {
    px: v => LEFT + (v - x0) / (x1 - x0) * w, py: v => TOP + (y1 - v) / (y1 - y0) * h,
    x: p => x0 + (p - LEFT) / w * (x1 - x0), y: p => y1 - (p - TOP) / h * (y1 - y0),
  };
}

function draw(context, panel, view, width, height, drag) {
  const s = scale(view, width, height);
  context.clearRect(0, 0, width, height);
  context.font = "12px system-ui, sans-serif";
  context.fillStyle = "#222";
  context.textAlign = "center";
  context.fillText(panel.title, width / 2, 15);
  context.fillText(panel.x, LEFT + (width - LEFT - RIGHT) / 2, height - 8);
  context.save(); context.translate(13, TOP + (height - TOP - BOTTOM) / 2); context.rotate(-Math.PI / 2);
  context.fillText(panel.y, 0, 0); context.restore();
  context.strokeStyle = "#e4e4e4"; context.lineWidth = 1;
  for (const [axis, wanted] of [["x", 7], ["y", 6]]) {
    const { step, at } = ticks(view[axis][0], view[axis][1], wanted);
    for (const v of at) {
      context.beginPath();
      if (axis === "x") { context.moveTo(s.px(v), TOP); context.lineTo(s.px(v), height - BOTTOM); }
      else { context.moveTo(LEFT, s.py(v)); context.lineTo(width - RIGHT, s.py(v)); }
      context.stroke();
      context.textAlign = axis === "x" ? "center" : "right";
      if (axis === "x") context.fillText(label(v, step), s.px(v), height - BOTTOM + 16);
      else context.fillText(label(v, step), LEFT - 6, s.py(v) + 4);
    }
  }
  context.save();
  context.beginPath(); context.rect(LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM); context.clip();
  for (const line of panel.lines) {
    context.strokeStyle = context.fillStyle = line.color;
    context.lineWidth = line.width; context.setLineDash(line.dashed ? [6, 4] : []);
    if (line.dots)
      for (let i = 0; i < line.x.length; i++) context.fillRect(s.px(line.x[i]) - 1, s.py(line.y[i]) - 1, 2.5, 2.5);
    if (!line.joined) continue;
    context.beginPath();
    let down = false;
    for (let i = 0; i < line.x.length; i++) {
      if (!Number.isFinite(line.x[i] + line.y[i])) { down = false; continue; }
      if (down) context.lineTo(s.px(line.x[i]), s.py(line.y[i])); else context.moveTo(s.px(line.x[i]), s.py(line.y[i]));
      down = true;
    }
    context.stroke();
  }
  context.restore();
  context.setLineDash([]); context.strokeStyle = "#888"; context.lineWidth = 1;
  context.strokeRect(LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM);
  context.textAlign = "left";
  panel.lines.filter(line => line.label).forEach((line, i) => {
    context.fillStyle = line.color; context.fillRect(LEFT + 8, TOP + 9 + 16 * i, 14, 3);
    context.fillStyle = "#222"; context.fillText(line.label, LEFT + 27, TOP + 15 + 16 * i);
  });
  if (drag) context.strokeRect(drag.x, drag.y, drag.toX - drag.x, drag.toY - drag.y);
}

function place(panel, canvas) {
  let view = panel.view, drag = null;
  const at = event => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
  const again = () => {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio; canvas.height = height * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    draw(context, panel, view, width, height, drag);
  };
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    const [x, y] = at(event), s = scale(view, canvas.clientWidth, canvas.clientHeight), factor = event.deltaY > 0 ? 1.25 : 0.8;
    view = { x: zoomed(view.x, s.x(x), factor), y: event.shiftKey ? view.y : zoomed(view.y, s.y(y), factor) };
    again();
  }, { passive: false });
  canvas.addEventListener("pointerdown", event => {
    const [x, y] = at(event);
    drag = { x, y, toX: x, toY: y }; canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", event => { if (drag) { [drag.toX, drag.toY] = at(event); again(); } });
  canvas.addEventListener("pointerup", () => {
    const d = drag, s = scale(view, canvas.clientWidth, canvas.clientHeight);
    drag = null;
    if (d && Math.abs(d.toX - d.x) > 5 && Math.abs(d.toY - d.y) > 5) {
      const sorted = (a, b) => a < b ? [a, b] : [b, a];
      view = { x: sorted(s.x(d.x), s.x(d.toX)), y: sorted(s.y(d.y), s.y(d.toY)) };
    }
    again();
  });
  canvas.addEventListener("dblclick", () => { view = panel.view; again(); });
  window.addEventListener("resize", again);
  again();
}

function open(figure) {
  const data = JSON.parse(figure.querySelector("script").textContent), arrays = data.arrays.map(numbers);
  const grid = document.createElement("div");
  grid.className = "closer"; grid.style.gridTemplateColumns = `repeat(${data.columns}, 1fr)`;
  figure.querySelector("img").replaceWith(grid);
  for (const panel of data.panels) {
    for (const line of panel.lines) { line.x = arrays[line.x]; line.y = arrays[line.y]; }
    const canvas = document.createElement("canvas");
    canvas.style.gridRow = panel.row + 1; canvas.style.gridColumn = panel.column + 1;
    grid.append(canvas);
    place(panel, canvas);
  }
}

if (typeof document !== "undefined")
  document.querySelectorAll("figure.zoom").forEach(figure => {
    const button = figure.querySelector("button");
    button.hidden = false;
    button.addEventListener("click", () => {
      open(figure);
      button.replaceWith("The wheel zooms (with shift: sideways alone), dragging selects, a double click shows all again.");
    });
  });
else module.exports = { numbers, ticks, label, zoomed, scale, draw };
