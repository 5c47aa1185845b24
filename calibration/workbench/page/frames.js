"use strict";
// Frames of a press: the picture, its height map and a section through it; each is fetched when it is looked at.

const scrub = { press: "", at: {}, turn: 0, height: null, row: null };
// Cividis, told apart by all kinds of colour vision, at equal steps.
const RAMP = [[0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115], [138, 134, 120], [165, 156, 116], [195, 179, 105], [225, 204, 85], [254, 232, 56]];
const SHADES = Array.from({ length: 256 }, (_, k) => {
  const place = (RAMP.length - 1) * k / 255, below = Math.min(Math.floor(place), RAMP.length - 2);
  return RAMP[below].map((c, j) => Math.round(c + (place - below) * (RAMP[below + 1][j] - c)));
});

async function showFrames(press) {
  const place = document.getElementById("frames");
  if (!press) return;
  const name = `${press.recording}/${press.name}`;
  if (scrub.press === name) return;
  scrub.press = name; scrub.row = null; scrub.coming = false;
  const asked = await fetch(`frames?recording=${press.recording}&press=${encodeURIComponent(press.label)}`);
  const found = asked.ok ? await asked.json() : { frames: [], times: [] };
  if (scrub.press !== name) return;
  scrub.at = found; scrub.recording = press.recording;
  if (!found.frames.length) { place.replaceChildren(); return; }
  const last = found.frames.length - 1, event = found.event, known = event !== undefined && event !== null;
  const mark = known ? h("button", { id: "event", class: "link", style: `--at: ${last ? event / last : 0}`, onclick: () => seek(event) }, "▲ bevel touches") : "";
  const key = (kind, text) => h("span", { class: "key" }, h("span", { class: `swatch ${kind}` }), text);
  place.replaceChildren(
    h("div", { class: "line" }, h("h2", {}, "Frames of this press"), h("div", { class: "wide" }, h("label", {}, h("span", { id: "frame-words" }),
      h("input", { id: "frame", type: "range", min: 0, max: last, step: 1, value: known ? event : Math.round(last / 2), "aria-label": "Frame of the press", oninput: later })), mark)),
    h("div", { class: "pair" },
      h("figure", {}, h("div", { class: "over" }, h("img", { id: "frame-picture", alt: "the frame, rectified" }), places(found)), h("figcaption", { class: "soft" }, "The frame, rectified")),
      h("figure", {}, h("div", { class: "over" }, h("canvas", { id: "frame-height", tabindex: 0, role: "slider", "aria-label": "Row of the section; arrow keys move it",
        onpointerdown: drag, onpointermove: drag, onkeydown: nudge }), places(found), h("div", { id: "cut" })), h("figcaption", { class: "soft", id: "frame-scale" }))),
    found.face ? h("p", { class: "soft legend" }, key("face", "face of the punch, as found"), found.bevel ? key("bevel", "where its bevel is watched") : "",
      known ? "" : "No sure touch of the bevel.") : "",
    h("div", { class: "pair" }, h("div", { id: "section-chart", class: "chart low" }), found.force_s && found.force_s.length ? h("div", { id: "force-chart", class: "chart low" }) : ""));
  see();
}

/** Face and bevel over a picture, in shares of its width and height. */
function places(found) {
  const shape = (name, about) => { const node = document.createElementNS("http://www.w3.org/2000/svg", name); for (const key in about) node.setAttribute(key, about[key]); return node; };
  const over = shape("svg", { viewBox: "0 0 1 1", preserveAspectRatio: "none", "aria-hidden": "true" });
  if (found.face) over.append(...["halo", "face"].map((kind) => shape("ellipse", { cx: found.face[0], cy: found.face[1], rx: found.face[2], ry: found.face[3], class: kind })));
  if (found.bevel) over.append(...["halo", "bevel"].map((kind) => shape("rect", { x: found.bevel[0], y: found.bevel[1], width: found.bevel[2], height: found.bevel[3], class: kind })));
  return over;
}

function seek(at) { document.getElementById("frame").value = at; see(); }

/** While the slider moves small pictures follow it, one at a time; the height map comes where it rests. */
function later() {
  const where = tell(), picture = document.getElementById("frame-picture");
  clearTimeout(scrub.timer);
  scrub.timer = setTimeout(see, 120);
  scrub.turn += 1;
  if (scrub.coming) return;
  scrub.coming = true;
  picture.onload = picture.onerror = () => { scrub.coming = false; };
  picture.src = `small?${where}`;
}

/** Which frame it is, and where it stands in the press; what to ask the server for. */
function tell() {
  const at = Number(document.getElementById("frame").value), { frames, times, event } = scrub.at;
  document.getElementById("frame-words").textContent = `frame ${at + 1} of ${frames.length}, ${times[at].toFixed(2)} s after the first${at === event ? ": the bevel touches" : ""} `;
  if (document.getElementById("force-chart")) drawTouch("force-chart", scrub.at, times[at]);
  return `recording=${scrub.recording}&number=${frames[at]}`;
}

async function see() {
  const where = tell(), turn = ++scrub.turn;
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
  const { rows, columns, depth } = scrub.height, canvas = document.getElementById("frame-height"), deepest = scrub.at.deepest_mm;
  let low = Infinity, high = -Infinity;
  for (const value of depth) if (!Number.isNaN(value)) { if (value < low) low = value; if (value > high) high = value; }
  if (deepest) { low = -0.15 * deepest; high = 1.15 * deepest; }  // one scale for all frames of a press
  canvas.width = columns; canvas.height = rows;
  const context = canvas.getContext("2d"), image = context.createImageData(columns, rows), data = image.data, step = high > low ? 255 / (high - low) : 0;
  depth.forEach((value, k) => {
    const known = !Number.isNaN(value), colour = known ? SHADES[Math.max(0, Math.min(255, Math.round((value - low) * step)))] : null, at = 4 * k;
    data[at] = known ? colour[0] : 150; data[at + 1] = known ? colour[1] : 150; data[at + 2] = known ? colour[2] : 150; data[at + 3] = 255;
  });
  context.putImageData(image, 0, 0);
  canvas.setAttribute("aria-valuemin", 0); canvas.setAttribute("aria-valuemax", rows - 1);
  document.getElementById("frame-scale").textContent = `Depth from ${low.toFixed(2)} (dark) to ${high.toFixed(2)} mm (bright); grey: not known. Drag the line.`;
  scrub.reach = [high, low];
  cut();
}

/** After a change of the model: the certified depth stays, the factor of what was read may not. */
async function certify() {
  const name = scrub.press, press = state.presses.find((one) => one.name === chosen);
  if (!press || !scrub.height) return;
  const asked = await fetch(`frames?recording=${press.recording}&press=${encodeURIComponent(press.label)}`);
  if (!asked.ok || scrub.press !== name) return;
  scrub.at = await asked.json();
  cut();
}

/** The line over the height map, and the depth along it: as read, corrected by the effects in the model, and certified. */
function cut() {
  const { rows, columns, depth, scale } = scrub.height, { certified_mm: certified, factor } = scrub.at;
  document.getElementById("frame-height").setAttribute("aria-valuenow", scrub.row);
  document.getElementById("cut").style.top = `${100 * (scrub.row + 0.5) / rows}%`;
  const line = Array.from(depth.subarray(scrub.row * columns, (scrub.row + 1) * columns), (v) => (Number.isNaN(v) ? null : v));
  const x = line.map((_, k) => k * scale), corrected = factor !== undefined && Math.abs(factor - 1) > 1e-6;
  const traces = [{ x, y: line, mode: "lines", name: "as read", line: { color: css(corrected ? "--first" : "--last"), width: 2 } }];
  if (corrected) traces.push({ x, y: line.map((v) => (v === null ? null : v * factor)), mode: "lines", name: "corrected", line: { color: css("--last"), width: 2 } });
  if (certified !== undefined) traces.push({ x: [0, x[x.length - 1]], y: [certified, certified], mode: "lines", name: "certified", line: { color: css("--good"), width: 2, dash: "dash" } });
  draw("section-chart", traces, layout("place (mm)", "depth (mm)", { yaxis: { range: [Math.max(scrub.reach[0], 1.1 * (certified || 0)), scrub.reach[1]] }, showlegend: traces.length > 1,
    legend: { orientation: "h", y: 1.12, yanchor: "bottom", x: 0, font: { size: 11 } }, margin: { l: 52, r: 8, t: 36, b: 38 } }));
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
  cut();
}
