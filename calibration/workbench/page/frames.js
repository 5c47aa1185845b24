"use strict";
// Frames of a press: the picture, its height map and a section through it; each is fetched when it is looked at.

const scrub = { press: "", at: {}, turn: 0, height: null, line: null };
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
  Object.assign(scrub, { press: name, line: null, height: null, coming: false });
  const asked = await fetch(`frames?recording=${press.recording}&press=${encodeURIComponent(press.label)}`);
  const found = asked.ok ? await asked.json() : { frames: [], times: [] };
  if (scrub.press !== name) return;
  scrub.at = found; scrub.recording = press.recording;
  if (!found.frames.length) { place.replaceChildren(); return; }
  const last = found.frames.length - 1, event = found.event, known = event !== undefined && event !== null;
  const mark = known ? h("button", { id: "event", class: "link", style: `--at: ${last ? event / last : 0}`, onclick: () => seek(event) }, "▲ bevel touches") : "";
  const key = (kind, text) => h("span", { class: "key" }, h("span", { class: `swatch ${kind}` }), text);
  const map = h("figure", {}, h("div", { class: "over" }, h("canvas", { id: "frame-height", tabindex: 0, role: "application",
    "aria-label": "Height map with a section: drag draws one, arrow keys move it, Shift and arrow keys turn it", onpointerdown: drag, onpointermove: drag, onpointerup: drag, onkeydown: nudge }),
  places(found), shape("svg", { id: "cut", "aria-hidden": "true", preserveAspectRatio: "none" })),
  h("div", { id: "depth-bar", class: "bar soft" }, h("span", {}), h("span", { class: "ramp", style: `background: linear-gradient(to right, ${RAMP.map((c) => `rgb(${c})`).join()})` }), h("span", {})),
  h("figcaption", { class: "soft" }, h("span", { id: "map-words" }), h("button", { class: "link", onclick: saveMap }, "Save picture")));
  place.replaceChildren(
    h("div", { class: "line" }, h("h2", {}, "Frames of this press"), h("div", { class: "wide" }, h("label", {}, h("span", { id: "frame-words" }),
      h("input", { id: "frame", type: "range", min: 0, max: last, step: 1, value: known ? event : Math.round(last / 2), "aria-label": "Frame of the press", oninput: later })), mark)),
    h("div", { class: "pair" },
      h("figure", {}, h("div", { class: "over" }, h("img", { id: "frame-picture", alt: "the frame, rectified" }), places(found)), h("figcaption", { class: "soft" }, "The frame, rectified")),
      found.heights ? map : h("p", { class: "soft" }, "Its height map follows when the light is calibrated.")),
    found.face ? h("p", { class: "soft legend" }, key("face", "face of the punch, as found"), found.bevel ? key("bevel", "where its bevel is watched") : "",
      known ? "" : "No sure touch of the bevel.") : "",
    h("div", { class: "pair" }, found.heights ? chartOf("section-chart", "Depth along the section") : "",
      found.force_s && found.force_s.length ? chartOf("force-chart", "Force and depth read by the camera during the press") : ""));
  see();
}

function shape(name, about) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const key in about) node.setAttribute(key, about[key]);
  return node;
}

/** Face and bevel over a picture, in shares of its width and height. */
function places(found) {
  const over = shape("svg", { viewBox: "0 0 1 1", preserveAspectRatio: "none", "aria-hidden": "true" });
  if (found.face) over.append(...["halo", "face"].map((kind) => shape("ellipse", { cx: found.face[0], cy: found.face[1], rx: found.face[2], ry: found.face[3], class: kind })));
  if (found.bevel) over.append(...["halo", "bevel"].map((kind) => shape("rect", { x: found.bevel[0], y: found.bevel[1], width: found.bevel[2], height: found.bevel[3], class: kind })));
  return over;
}

function seek(at) { document.getElementById("frame").value = at; see(); }

/** From a place of the force's chart to the nearest frame; `rest` fetches its height map at once. */
function seekTime(time, rest) {
  const { times } = scrub.at, near = times.reduce((best, one, k) => (Math.abs(one - time) < Math.abs(times[best] - time) ? k : best), 0);
  if (rest) seek(near);
  else if (Number(document.getElementById("frame").value) !== near) { document.getElementById("frame").value = near; later(); }
}

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
  if (!scrub.at.heights) { document.getElementById("frame-picture").src = `picture?${where}`; return; }
  const answer = await fetch(`height?${where}`);
  if (turn !== scrub.turn) return;
  if (!answer.ok) { say((await answer.json()).error); return; }
  document.getElementById("frame-picture").src = `picture?${where}`;
  const rows = Number(answer.headers.get("X-Rows")), columns = Number(answer.headers.get("X-Columns"));
  const depth = new Float32Array(await answer.arrayBuffer());
  if (turn !== scrub.turn) return;
  scrub.height = { rows, columns, depth, scale: Number(answer.headers.get("X-Mm-Per-Px")) };
  if (!scrub.line) scrub.line = across(deepestRow());
  paint();
}

/** A level section through a row, from edge to edge, px. */
function across(row) { return [[0, row], [scrub.height.columns - 1, row]]; }

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
  const ends = document.getElementById("depth-bar").children;
  ends[0].textContent = `${low.toFixed(2)} mm`; ends[2].textContent = `${high.toFixed(2)} mm deep`;
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

/** The largest of 1, 2, 5, 10 ... mm within a quarter of the picture. */
function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return power * [5, 2, 1].find((one) => one * power <= most);
}

/** The line over the height map with a scale bar, and the depth along it: as read, corrected by the effects in the model, and certified. */
function cut() {
  const { rows, columns, depth, scale } = scrub.height, { certified_mm: certified, factor } = scrub.at, [[x0, y0], [x1, y1]] = scrub.line;
  const over = document.getElementById("cut"), length = roundLength(columns * scale / 4), bar = length / scale, left = 0.04 * columns, base = 0.94 * rows;
  over.setAttribute("viewBox", `0 0 ${columns} ${rows}`);
  const line = (kind, a, b, c, d) => shape("line", { x1: a, y1: b, x2: c, y2: d, class: kind });
  const words = shape("text", { x: left, y: base - 0.03 * rows, class: "scale-words", "font-size": 0.055 * rows });
  words.textContent = `${length} mm`;
  scrub.dot = shape("circle", { r: 0.014 * columns, class: "cut-dot", visibility: "hidden" });
  over.replaceChildren(...["halo", "section"].map((kind) => line(kind, x0, y0, x1, y1)), ...["halo", "scale"].map((kind) => line(kind, left, base, left + bar, base)), words, scrub.dot);
  const count = Math.max(2, Math.round(Math.hypot(x1 - x0, y1 - y0)) + 1), way = (k) => [x0 + (x1 - x0) * k / (count - 1), y0 + (y1 - y0) * k / (count - 1)];
  scrub.way = Array.from({ length: count }, (_, k) => way(k));
  const found = scrub.way.map(([x, y]) => { const v = depth[Math.round(y) * columns + Math.round(x)]; return Number.isNaN(v) ? null : v; });
  const x = scrub.way.map(([a, b]) => scale * Math.hypot(a - x0, b - y0)), corrected = factor !== undefined && Math.abs(factor - 1) > 1e-6;
  const turn = Math.round(Math.atan2(y0 - y1, x1 - x0) * 180 / Math.PI);
  document.getElementById("map-words").textContent = `Section of ${x[x.length - 1].toFixed(1)} mm at ${turn}°. Drag to draw another; grey: not known. `;
  const hovertemplate = "%{x:.2f} mm along: %{y:.3f} mm<extra>%{fullData.name}</extra>";
  const traces = [{ x, y: found, mode: "lines", name: "as read", hovertemplate, line: { color: css(corrected ? "--first" : "--last"), width: 2 } }];
  if (corrected) traces.push({ x, y: found.map((v) => (v === null ? null : v * factor)), mode: "lines", name: "corrected", hovertemplate, line: { color: css("--last"), width: 2 } });
  if (certified !== undefined) traces.push({ x: [0, x[x.length - 1]], y: [certified, certified], mode: "lines", name: "certified", hovertemplate, line: { color: css("--good"), width: 2, dash: "dash" } });
  const node = draw("section-chart", traces, layout("along the section (mm)", "depth (mm)", { yaxis: { range: [Math.max(scrub.reach[0], 1.1 * (certified || 0)), scrub.reach[1]] }, showlegend: traces.length > 1,
    legend: { orientation: "h", y: 1.12, yanchor: "bottom", x: 0, font: { size: 11 } }, margin: { l: 52, r: 8, t: 36, b: 38 } }));
  listen(node, "plotly_hover", (event) => {
    const at = scrub.way[event.points[0].pointNumber];
    if (at && event.points[0].curveNumber === 0) for (const [name, value] of [["cx", at[0]], ["cy", at[1]], ["visibility", "visible"]]) scrub.dot.setAttribute(name, value);
  });
  listen(node, "plotly_unhover", () => scrub.dot.setAttribute("visibility", "hidden"));
}

/** A drag draws a section from one place to another, a click a level one; a pointer that only moves reads the depth. */
function drag(event) {
  if (!scrub.height) return;
  const canvas = event.currentTarget, box = canvas.getBoundingClientRect(), { rows, columns, depth, scale } = scrub.height;
  const at = [[event.clientX - box.left, box.width, columns], [event.clientY - box.top, box.height, rows]].map(([part, whole, count]) => Math.max(0, Math.min(count - 1, Math.floor(part / whole * count))));
  if (event.type === "pointerdown") { canvas.setPointerCapture(event.pointerId); scrub.from = at; }
  const value = depth[at[1] * columns + at[0]];
  canvas.title = `${(at[0] * scale).toFixed(2)}, ${(at[1] * scale).toFixed(2)} mm: ${Number.isNaN(value) ? "not known" : `${value.toFixed(3)} mm deep`}`;
  if (!event.buttons && event.type !== "pointerup") return;
  const far = scrub.from && Math.hypot(at[0] - scrub.from[0], at[1] - scrub.from[1]) > 4;
  if (far) scrub.line = [scrub.from, at];
  else if (event.type === "pointerup") scrub.line = across(at[1]);
  else return;
  cut();
}

/** Arrow keys move the section, with Shift they turn it about its middle. */
function nudge(event) {
  const way = { ArrowUp: [0, -2], ArrowDown: [0, 2], ArrowLeft: [-2, 0], ArrowRight: [2, 0] }[event.key];
  if (!way || !scrub.height) return;
  event.preventDefault();
  const { rows, columns } = scrub.height, [[x0, y0], [x1, y1]] = scrub.line, mid = [(x0 + x1) / 2, (y0 + y1) / 2];
  const angle = event.shiftKey ? Math.sign(way[0] + way[1]) * Math.PI / 36 : 0, [c, s] = [Math.cos(angle), Math.sin(angle)], move = event.shiftKey ? [0, 0] : way;
  const fit = ([x, y]) => [Math.max(0, Math.min(columns - 1, x)), Math.max(0, Math.min(rows - 1, y))];
  scrub.line = scrub.line.map(([x, y]) => fit([mid[0] + move[0] + c * (x - mid[0]) - s * (y - mid[1]), mid[1] + move[1] + s * (x - mid[0]) + c * (y - mid[1])]));
  cut();
}

/** The height map as a PNG, with what is drawn over it. */
function saveMap() {
  const { rows, columns } = scrub.height, big = document.createElement("canvas"), context = big.getContext("2d"), grow = Math.max(1, Math.round(1200 / columns));
  big.width = grow * columns; big.height = grow * rows;
  context.imageSmoothingEnabled = false;
  context.drawImage(document.getElementById("frame-height"), 0, 0, big.width, big.height);
  context.scale(grow, grow);
  for (const node of document.getElementById("cut").querySelectorAll("line:not(.halo)")) {
    context.strokeStyle = getComputedStyle(node).stroke; context.lineWidth = 1.5;
    context.beginPath(); context.moveTo(node.x1.baseVal.value, node.y1.baseVal.value); context.lineTo(node.x2.baseVal.value, node.y2.baseVal.value); context.stroke();
  }
  const words = document.querySelector("#cut text"), ends = document.getElementById("depth-bar");
  context.fillStyle = "#ffffff"; context.font = `${0.055 * rows}px system-ui, sans-serif`;
  context.fillText(`${words.textContent}; ${ends.firstChild.textContent} (dark) to ${ends.lastChild.textContent} (bright)`, words.x.baseVal[0].value, words.y.baseVal[0].value);
  h("a", { href: big.toDataURL("image/png"), download: `height_map_${scrub.press.replace(/\W+/g, "_")}.png` }).click();
}
