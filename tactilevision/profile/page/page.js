"use strict";
// Circles of ball presses: drawn here, kept and fitted by the program that serves this page.

const at = (id) => document.getElementById(id);
const canvas = at("picture");
const state = { about: null, now: 0, view: "picture", picture: null, drag: null, outcome: null, fitting: false, again: false,
  dirty: false };
const EDGE_PX = 9, WAIT_MS = 350, BAD_DEG = 17;
let waiting = 0;

async function ask(path, body) {
  const answer = await fetch(path, body === undefined ? {} : {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
  const said = await answer.json();
  if (!answer.ok) throw new Error(said.error || "refused");
  return said;
}

function tell(id, text) {
  at(id).textContent = text;
  at(id).hidden = text === "";
}

const press = () => state.about.presses[state.now];
const told = (index) => state.outcome && state.outcome.presses && state.outcome.presses[state.about.presses[index].frame];

// ---- the list of presses

function shortened(name) {
  const ending = name.slice(name.lastIndexOf("/"));
  const shared = name.includes("/") && state.about.presses.every((one) => one.frame.endsWith(ending));
  return shared ? name.slice(0, -ending.length) : name;
}

function drawList() {
  const list = at("presses");
  list.replaceChildren(...state.about.presses.map((one, index) => {
    const row = document.createElement("li"), button = document.createElement("button");
    const parts = { dot: "", frame: shortened(one.frame), off: "", state: one.state };
    const found = told(index);
    if (found && found.direction_deg !== null) parts.off = found.direction_deg.toFixed(1) + "°";
    for (const [name, text] of Object.entries(parts)) {
      const part = document.createElement("span");
      part.className = name + (name === "off" && found && found.direction_deg > BAD_DEG ? " bad" : "");
      part.textContent = text;
      button.append(part);
    }
    button.title = one.frame + (one.why ? ": " + one.why : "");
    button.dataset.state = one.state;
    button.setAttribute("aria-current", String(index === state.now));
    button.addEventListener("click", () => go(index));
    row.append(button);
    return row;
  }));
  const count = (name) => state.about.presses.filter((one) => one.state === name).length;
  const rest = ["not found", "excluded"].filter(count).map((name) => `, ${count(name)} ${name}`).join("");
  at("count").textContent = `${state.about.presses.length} presses, ${count("checked")} checked${rest}`;
}

// ---- the picture and its circles

function scale() { return canvas.clientWidth / state.about.size[0]; }

function drawPicture() {
  const [width, height] = state.about.size, wide = canvas.clientWidth;
  const pen = sharpen(canvas, wide, wide * height / width), zoom = wide / width;
  pen.imageSmoothingEnabled = zoom < 2;
  if (state.picture) pen.drawImage(state.picture, 0, 0, wide, wide * height / width);
  const round = (circle, colours, dash) => {
    const [x, y, radius] = circle.map((value) => value * zoom);
    pen.setLineDash(dash);
    for (const [colour, thick] of colours) {
      pen.strokeStyle = colour;
      pen.lineWidth = thick;
      pen.beginPath();
      pen.arc(x + zoom / 2, y + zoom / 2, radius, 0, 7);
      pen.stroke();
    }
    pen.setLineDash([]);
  };
  const one = press(), found = told(state.now);
  if (one.circle && one.state !== "excluded") {
    round(one.circle, [["rgba(0,0,0,.55)", 3.5], ["#fff", 1.7]], []);
    const [x, y] = one.circle.map((value) => (value + 0.5) * zoom);
    pen.strokeStyle = "#fff";
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(x - 6, y); pen.lineTo(x + 6, y); pen.moveTo(x, y - 6); pen.lineTo(x, y + 6);
    pen.stroke();
    if (found) round(found.circle, [["#f08a24", 2]], [6, 5]);
  }
  const [x, y, radius] = one.circle || [];
  at("circle").textContent = one.circle && one.state !== "excluded" ?
    `x ${x.toFixed(1)}  y ${y.toFixed(1)}  radius ${radius.toFixed(1)} px = ` +
    `${(radius * state.about.mm_per_px[0]).toFixed(2)} mm of a ball of ${one.radius_mm.toFixed(2)} mm` : "";
}

function loadPicture() {
  const picture = new Image(), index = state.now;
  picture.onload = () => { if (index === state.now) { state.picture = picture; drawPicture(); } };
  picture.onerror = () => { if (index === state.now && state.view === "depth") show("picture"); };
  picture.src = state.view + "/" + index + "?" + Date.now();
}

function show(view) {
  state.view = view;
  for (const button of document.querySelectorAll("[data-view]"))
    button.setAttribute("aria-pressed", String(button.dataset.view === view));
  loadPicture();
}

async function drawPress() {
  const one = press(), found = told(state.now), index = state.now;
  at("title").textContent = at("title").title = one.frame;
  tell("why", one.why ? `No ball was found here: ${one.why}. Click its middle, or leave it out.` : "");
  at("left").firstChild.textContent = one.state === "excluded" ? "Include " : "Exclude ";
  at("check").disabled = !one.circle;
  document.querySelector('[data-view="depth"]').disabled = !found;
  at("one").textContent = found ? `${found.direction_deg.toFixed(1)}° off, depth ${found.depth_ratio.toFixed(2)} of the ball's` : "";
  drawPicture();
  const section = found ? await ask("section/" + index) : {};
  if (index === state.now) drawSection(at("section"), section);
}

function go(index) {
  state.now = Math.max(0, Math.min(index, state.about.presses.length - 1));
  if (state.view === "depth" && !told(state.now)) state.view = "picture";
  state.picture = null;
  drawList();
  at("presses").children[state.now].scrollIntoView({ block: "nearest" });
  show(state.view);
  drawPress();
}

// ---- what a person does

async function set(circle, what) {
  const index = state.now;
  try {
    state.about.presses[index] = await ask("set/" + index, { circle, state: what });
  } catch (fault) {
    tell("why", fault.message);
    return;
  }
  changed();
}

function changed() {
  state.dirty = true;
  at("saved").textContent = "not saved";
  drawList();
  drawPress();
  fitSoon();
}

function moved(dx, dy, wider) {
  const circle = press().circle;
  if (!circle) return;
  press().circle = [circle[0] + dx, circle[1] + dy, Math.max(2, circle[2] + wider)];
  drawPicture();
  clearTimeout(moved.timer);
  const index = state.now;
  moved.timer = setTimeout(() => { if (index === state.now) set(press().circle, "drawn"); }, 300);
}

async function find() {
  const index = state.now, one = press();
  const found = await ask("find/" + index, { circle: one.circle });
  state.about.presses[index] = found;
  changed();
}

function leaveOut() {
  const one = press();
  if (one.state !== "excluded") set(one.circle, "excluded");
  else if (one.circle) set(one.circle, "drawn");
  else find();
}

async function check() {
  if (!press().circle) return;
  await set(press().circle, "checked");
  const next = state.about.presses.findIndex((one, index) => index > state.now && one.state !== "checked" && one.state !== "excluded");
  if (next >= 0) go(next);
}

function place(event) {
  const box = canvas.getBoundingClientRect();
  return [(event.clientX - box.left) / scale() - 0.5, (event.clientY - box.top) / scale() - 0.5];
}

function grip([x, y]) {
  const circle = press().circle;
  if (!circle || press().state === "excluded") return "new";
  const away = Math.hypot(x - circle[0], y - circle[1]);
  if (Math.abs(away - circle[2]) * scale() < EDGE_PX && away > 0.5 * circle[2]) return "edge";
  return away < circle[2] ? "move" : "new";
}

function usualRadius() {
  const known = state.about.presses.filter((one) => one.circle).map((one) => one.circle[2]).sort((a, b) => a - b);
  return known.length ? known[known.length >> 1] : state.about.size[0] / 12;
}

canvas.addEventListener("pointerdown", (event) => {
  const [x, y] = place(event), how = grip([x, y]), one = press();
  if (how === "new") one.circle = [x, y, one.circle ? one.circle[2] : usualRadius()];
  if (one.state === "excluded") one.state = "drawn";
  state.drag = { how, from: [x, y], circle: [...one.circle] };
  canvas.setPointerCapture(event.pointerId);
  drawPicture();
});

canvas.addEventListener("pointermove", (event) => {
  const [x, y] = place(event);
  if (!state.drag) {
    canvas.style.cursor = { edge: "ew-resize", move: "move", new: "crosshair" }[grip([x, y])];
    return;
  }
  const { how, from, circle } = state.drag;
  press().circle = how === "edge" ? [circle[0], circle[1], Math.max(2, Math.hypot(x - circle[0], y - circle[1]))] :
    [circle[0] + x - from[0], circle[1] + y - from[1], circle[2]];
  drawPicture();
});

canvas.addEventListener("pointerup", () => {
  if (!state.drag) return;
  state.drag = null;
  set(press().circle, "drawn");
});

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || !state.about) return;
  const small = event.shiftKey ? 0.2 : 1;
  const keys = {
    ArrowLeft: () => moved(-small, 0, 0), ArrowRight: () => moved(small, 0, 0), ArrowUp: () => moved(0, -small, 0),
    ArrowDown: () => moved(0, small, 0), "+": () => moved(0, 0, 0.5), "=": () => moved(0, 0, 0.5), "-": () => moved(0, 0, -0.5),
    f: find, x: leaveOut, Enter: check, n: () => go(state.now + 1), p: () => go(state.now - 1),
    v: () => show(state.view === "picture" ? "change" : "picture"),
  };
  if (event.key === "Enter" && event.target.tagName === "BUTTON" && event.target.id !== "check" && !event.target.closest("nav")) return;
  if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
});

// ---- the fit

function fitSoon() {
  clearTimeout(waiting);
  waiting = setTimeout(fit, WAIT_MS);
}

async function fit() {
  if (state.fitting) { state.again = true; return; }
  state.fitting = true;
  at("busy").textContent = "fitting …";
  try {
    state.outcome = await ask("fit", {});
  } catch (fault) {
    state.outcome = { fault: fault.message };
  }
  state.fitting = false;
  at("busy").textContent = "";
  const found = state.outcome, known = !found.fault;
  at("direction").textContent = known ? found.direction_deg.toFixed(1) + "° off" : "–";
  at("depth").textContent = known && found.depth_ratio !== null ? found.depth_ratio.toFixed(2) : "–";
  at("balls").textContent = known ? `${found.balls} of ${state.about.presses.length}` : "–";
  tell("fault", known ? found.unfit.join(" ") : found.fault);
  at("warned").hidden = !(known && found.warnings.length);
  if (known) {
    at("warned").firstChild.textContent = found.warnings.length === 1 ? "1 warning" : `${found.warnings.length} warnings`;
    at("warnings").replaceChildren(...found.warnings.map((text) => {
      const item = document.createElement("li");
      item.textContent = text;
      return item;
    }));
  }
  drawList();
  if (state.view === "depth") loadPicture();
  await drawPress();
  document.body.dataset.fits = String(1 + Number(document.body.dataset.fits || 0));
  if (state.again) { state.again = false; fitSoon(); }
}

// ---- the end

async function save() {
  await ask("save", {});
  state.dirty = false;
  at("saved").textContent = "saved";
}

at("save").addEventListener("click", save);
at("done").addEventListener("click", async () => {
  await ask("done", {});
  state.dirty = false;
  const end = document.createElement("p");
  end.className = "end";
  end.textContent = "The circles are saved. The terminal goes on; this page can be closed.";
  document.body.replaceChildren(end);
});
at("find").addEventListener("click", find);
at("left").addEventListener("click", leaveOut);
at("check").addEventListener("click", check);
for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => show(button.dataset.view));
window.addEventListener("resize", () => { if (state.about) drawPress(); });
window.addEventListener("beforeunload", (event) => { if (state.dirty) event.preventDefault(); });

ask("presses").then((about) => {
  state.about = about;
  at("name").textContent = about.name;
  at("table").textContent = about.table;
  const first = about.presses.findIndex((one) => one.state === "not found");
  go(first >= 0 ? first : 0);
  fit();
});
