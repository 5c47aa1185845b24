"use strict";
// Frames of a press: the picture, its height map and a section through it; each is fetched when it is looked at.

const scrub = { press: "", list: [], times: [], turn: 0, height: null, row: null };
// Cividis, told apart by all kinds of colour vision, at equal steps.
const RAMP = [[0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115], [138, 134, 120], [165, 156, 116], [195, 179, 105], [225, 204, 85], [254, 232, 56]];

async function showFrames(press) {
  const place = document.getElementById("frames");
  if (!press) return;
  const name = `${press.recording}/${press.name}`;
  if (scrub.press === name) return;
  scrub.press = name; scrub.row = null;
  const asked = await fetch(`frames?recording=${press.recording}&press=${encodeURIComponent(press.label)}`);
  const found = asked.ok ? await asked.json() : { frames: [], times: [] };
  if (scrub.press !== name) return;
  scrub.list = found.frames; scrub.times = found.times; scrub.recording = press.recording;
  if (!found.frames.length) { place.replaceChildren(); return; }
  const last = found.frames.length - 1;
  place.replaceChildren(
    h("div", { class: "line" }, h("h2", {}, "Frames of this press"), h("label", { class: "wide" }, h("span", { id: "frame-words" }),
      h("input", { id: "frame", type: "range", min: 0, max: last, step: 1, value: Math.round(last / 2), "aria-label": "Frame of the press", oninput: later }))),
    h("div", { class: "pair" },
      h("figure", {}, h("img", { id: "frame-picture", alt: "the frame, rectified" }), h("figcaption", { class: "soft" }, "The frame, rectified")),
      h("figure", {}, h("canvas", { id: "frame-height", tabindex: 0, role: "slider", "aria-label": "Row of the section; arrow keys move it",
        onpointerdown: drag, onpointermove: drag, onkeydown: nudge }), h("figcaption", { class: "soft", id: "frame-scale" }))),
    h("div", { id: "section-chart", class: "chart low" }));
  see();
}

/** While the slider moves only the last frame is asked for. */
function later() {
  clearTimeout(scrub.timer);
  scrub.timer = setTimeout(see, 80);
}

async function see() {
  const at = Number(document.getElementById("frame").value), number = scrub.list[at], turn = ++scrub.turn;
  document.getElementById("frame-words").textContent = `frame ${at + 1} of ${scrub.list.length}, ${scrub.times[at] === null ? "no time" : `${scrub.times[at].toFixed(2)} s after the first`} `;
  const where = `recording=${scrub.recording}&number=${number}`;
  const answer = await fetch(`height?${where}`);
  if (turn !== scrub.turn) return;
  if (!answer.ok) { say((await answer.json()).error); return; }
  document.getElementById("frame-picture").src = `picture?${where}`;
  const rows = Number(answer.headers.get("X-Rows")), columns = Number(answer.headers.get("X-Columns"));
  const depth = new Float32Array(await answer.arrayBuffer());
  if (turn !== scrub.turn) return;
  scrub.height = { rows, columns, depth, scale: Number(answer.headers.get("X-Mm-Per-Px")) };
  if (scrub.row === null || scrub.row >= rows) scrub.row = deepestRow();
  paint();
}

/** The row to begin the section in: that of the deepest pixel. */
function deepestRow() {
  const { depth, columns, rows } = scrub.height;
  let at = -1;
  depth.forEach((value, k) => { if (value > (at < 0 ? -Infinity : depth[at])) at = k; });
  return at < 0 ? Math.floor(rows / 2) : Math.floor(at / columns);
}

function paint() {
  const { rows, columns, depth, scale } = scrub.height, canvas = document.getElementById("frame-height");
  let low = Infinity, high = -Infinity;
  for (const value of depth) if (!Number.isNaN(value)) { low = Math.min(low, value); high = Math.max(high, value); }
  canvas.width = columns; canvas.height = rows;
  const context = canvas.getContext("2d"), image = context.createImageData(columns, rows);
  depth.forEach((value, k) => {
    const place = (RAMP.length - 1) * (high > low ? (value - low) / (high - low) : 0), below = Math.min(Math.floor(place), RAMP.length - 2);
    const colour = Number.isNaN(value) ? [150, 150, 150] : RAMP[below].map((c, j) => c + (place - below) * (RAMP[below + 1][j] - c));
    image.data.set([...colour, 255], 4 * k);
  });
  context.putImageData(image, 0, 0);
  context.fillStyle = "#ff5a36";
  context.fillRect(0, scrub.row, columns, 1);
  canvas.setAttribute("aria-valuenow", scrub.row); canvas.setAttribute("aria-valuemin", 0); canvas.setAttribute("aria-valuemax", rows - 1);
  document.getElementById("frame-scale").textContent = `Depth from ${low.toFixed(3)} (dark) to ${high.toFixed(3)} mm (bright); grey: not known. Drag the line.`;
  const line = Array.from(depth.subarray(scrub.row * columns, (scrub.row + 1) * columns), (v) => (Number.isNaN(v) ? null : v));
  draw("section-chart", [{ x: line.map((_, k) => k * scale), y: line, mode: "lines", line: { color: css("--last"), width: 2 } }],
    layout("along the line (mm)", "depth (mm)", { yaxis: { autorange: "reversed" } }));
}

function drag(event) {
  if (event.type === "pointermove" && !event.buttons) return;
  const canvas = event.currentTarget, box = canvas.getBoundingClientRect();
  if (event.type === "pointerdown") canvas.setPointerCapture(event.pointerId);
  move(Math.floor(((event.clientY - box.top) / box.height) * scrub.height.rows));
}

function nudge(event) {
  const step = { ArrowUp: -1, ArrowDown: 1, PageUp: -10, PageDown: 10 }[event.key];
  if (!step || !scrub.height) return;
  event.preventDefault();
  move(scrub.row + step);
}

function move(row) {
  if (!scrub.height) return;
  scrub.row = Math.max(0, Math.min(scrub.height.rows - 1, row));
  paint();
}
