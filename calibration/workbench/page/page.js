"use strict";
// The page: shows what the server says stands, and hands over what a person does. It holds no physics and no statistics.

const $ = (id) => document.getElementById(id);
let state = null, curves = null, model = null, chosen = null, picked = false, certified = null, tried = null, seenSince = 0, sliding = null, watching = false;
const FIRST = 4, LITTLE = 0.01;  // cards that are shown at once; share of the error that is worth a card
const drawn = {};
const open = new Set();

/** An element; text goes in as text, so that no name of the data is ever read as markup. */
function h(tag, about = {}, ...inside) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(about)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(key, value);
  }
  for (const one of inside.flat(9)) if (one !== null && one !== undefined && one !== "") node.append(one);
  return node;
}

function fill(id, ...inside) { $(id).replaceChildren(...inside.flat(9).filter((one) => one !== null && one !== "")); }

/** Make a part of the page anew only where what it shows has changed, so that focus and scrolling stay. */
function part(name, content, make) {
  const key = JSON.stringify(content);
  if (drawn[name] === key) return;
  drawn[name] = key;
  make(content);
}

function say(text) { $("notice").textContent = text; }

async function ask(path) {
  const answer = await fetch(path, { cache: "no-store" });
  if (!answer.ok) throw new Error((await answer.json()).error);
  return answer.json();
}

async function act(action, value = "") {
  if (!lost) say("");
  try {
    const answer = await fetch("act", { method: "POST", headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ action, value, version: state.version }) });
    if (!answer.ok) say((await answer.json()).error);
  } catch { showLost(); }
}

const LOST = "The workbench has ended. ";
let lost = false;

/** The server has ended: the command that goes on, at the same address, so that this page comes back. */
function showLost() {
  lost = true; drawn.search = "";
  $("search").hidden = true;
  tick();
  $("notice").replaceChildren(LOST, ...(state && state.again ? ["To go on from what is kept: ", h("code", {}, state.again), ". This page then comes back by itself."] : ["The terminal says why, or prints the address to open."]));
}

/** The state before the server has imported its models: presses and frames as recorded. */
const EARLY = { busy: "starting", busy_s: 0, certified: false, warnings: [], falls: [], cards: [], components: [], stiffness: [], modulus: [], labels: [], weeks: [], sides: null, model: "",
  verdict: { with: [], named: [], nearest: [], remarks: [], warnings: [], next: [], tried: [], meanings: {} } };
let charts = null;

/** Load plotly, which takes longer than all else on the page, once presses and frames can be seen. */
function loadCharts() {
  charts ||= new Promise((done, failed) => { document.head.append(h("script", { src: "plotly.js", onload: done, onerror: () => { charts = null; failed(new TypeError("no answer")); } })); });
  return charts;
}

async function follow() {
  for (;;) {
    try {
      const news = await ask(`state?since=${state && !lost ? state.version : 0}`);
      if (lost) { lost = false; model = null; say(""); }
      if (news.certified) await loadCharts();
      state = { ...EARLY, ...news };
      seenSince = performance.now() - 1000 * state.busy_s;
      show();
      await loadCharts();
      if (state.model !== model && state.model) {
        const wanted = state.model;
        curves = await ask("curves");
        model = wanted; tried = null;
        showCurves();
      }
    } catch (fault) {
      if (fault instanceof TypeError) showLost(); else say(fault.message);
      await new Promise((done) => setTimeout(done, 2000));
    }
  }
}

function show() {
  document.title = `${state.title} – workbench`;
  $("title").textContent = state.title;
  $("undo").disabled = !state.undo; $("redo").disabled = !state.redo;
  $("label").disabled = $("export").disabled = !state.components.length;
  document.body.classList.toggle("early", !state.certified);
  if (state.notice) say(state.notice);
  part("saved", state.saved, showSaved);
  ranOwn();
  part("warnings", state.warnings, (warnings) => fill("warnings", warnings.map((text) => h("li", {}, `${/^\S*\./.test(text) ? text : capital(text)}.`.replace(/\.\.$/, ".")))));
  tick();
  const { asking, tried: effects, left_s: left, ...verdict } = state.verdict;
  part("verdict", [{ ...verdict, asking: Boolean(asking) }, state.certified], showVerdict);
  part("search", [asking, effects, left], showSearch);
  part("modulus", [state.modulus, state.unseen], showModulus);
  part("falls", state.falls, showFalls);
  part("components", [state.components, state.stiffness], showComponents);
  part("cards", [state.cards, state.earlier], showCards);
  if (!chosen && state.presses.length) chosen = state.presses[0].name;
  if (certified !== state.certified) {  // frames at once, what is known of them later
    certified = state.certified; scrub.press = "";
    showFrames(state.presses.find((one) => one.name === chosen));
  }
  part("presses", [state.presses, chosen], showPresses);
  part("states", [state.labels, state.components.map((c) => c.key)], showStates);
  part("sides", state.sides, showSides);
  part("weeks", state.weeks, showWeeks);
}

function tick() {
  const busy = state && state.busy && !lost, seconds = busy ? (performance.now() - seenSince) / 1000 : 0;
  $("busy").className = busy ? "on" : "";
  $("stop").hidden = !(busy && state.stoppable && seconds > 1);
  $("busy").textContent = busy ? `${state.busy}${seconds > 1 ? `, ${seconds.toFixed(0)} s` : ""}` : "";
}

/** What was exported, which opens in a tab of its own where the browser lets it. */
function showSaved(saved) {
  if (!saved) return;
  $("notice").replaceChildren("Written: ", h("a", { href: "report.html", target: "_blank" }, "open the report"), `, ${saved}, with calibration.json and repeat.sh in the same folder.`);
  if (exporting) open_("report.html");
  exporting = false;
}

let exporting = false, running = null;
const open_ = (address) => globalThis.open(address, "_blank");

/** The editor of an effect of one's own; a draft stays until it is begun anew. */
function editOwn(anew) {
  const text = state.verdict.own_effect || state.verdict.template;
  if (anew || !$("own-text").value) $("own-text").value = text;
  $("own-fault").textContent = "";
  if (!$("own").open) $("own").showModal();
}

function runOwn() {
  running = { model: state.model, version: state.version, notice: state.notice };
  $("own-run").disabled = true; $("own-fault").textContent = "It is being run and fitted.";
  act("own", $("own-text").value);
}

/** Whether the effect that runs was added, or why not. */
function ranOwn() {
  if (!running) return;
  if (state.busy.startsWith("running")) running.seen = true;
  const added = state.model !== running.model, failed = !state.busy.startsWith("running") && state.notice && (running.seen || state.notice !== running.notice);
  if (!added && !failed) return;
  running = null; $("own-run").disabled = false;
  $("own-fault").textContent = added ? "" : state.notice;
  if (added) { $("own").close(); toTop(); }
}

function capital(text) { return text[0].toUpperCase() + text.slice(1); }

function showVerdict([verdict]) {
  const add = (keys, words) => h("button", { class: "main", "data-cure": keys.length > 1 ? "all" : keys[0], onclick: () => { act("add", keys.join("\n")); toTop(); } }, words);
  const effects = `Model: ${["base model", ...verdict.with].join(" + ")}.`, named = verdict.named;
  $("verdict").className = verdict.word ? (verdict.word === "ADEQUATE" ? "clean" : "found") : "";
  fill("verdict",
    verdict.word ? h("p", { class: "lead" }, h("b", {}, verdict.word), `. ${verdict.sentence}`)
      : h("p", { class: "lead" }, verdict.troubled ? `No verdict: ${verdict.troubled}` : !state.certified ? "The presses are being certified; their frames can be seen below." : verdict.asking ? "Searching for missing effects. The verdict follows." : "No verdict yet."),
    h("p", { class: "soft" }, verdict.word || !named.length ? effects : "Named by the diagnosis before, and not added yet:"),
    named.length ? h("p", {}, named.length > 1 ? add(named.map((one) => one.key), named.length > 2 ? "Add all" : "Add both") : "", named.map((one) => add([one.key], `Add ${one.title}`)),
      verdict.word ? " and watch the error fall." : "") : "",
    verdict.nearest.length ? h("p", {}, verdict.nearest.map((one) => add([one.key], `Try ${one.title}`)), " and see whether the error falls.") : "",
    verdict.word === "UNKNOWN" ? h("p", {}, h("button", { class: verdict.nearest.length ? "" : "main", "data-own": "", onclick: () => editOwn(false) }, "Write an effect of your own"),
      verdict.own_effect ? " that begins with the shape of the residual." : "") : "",
    verdict.remarks.map((text) => h("p", { class: "soft" }, text)),
    verdict.warnings.length ? h("ul", { class: "bad" }, verdict.warnings.map((text) => h("li", {}, text))) : "",
    verdict.next.length ? [h("h2", {}, "Measure next"), h("ul", {}, verdict.next.slice(0, 3).map((one) => h("li", {}, `${one.action} (${one.minutes} minutes`,
      one.gain ? `, expected to separate the candidates by ${one.gain} std)` : ")", one.why ? h("span", { class: "soft" }, `: ${one.why}`) : "")))] : "",
    h("details", { open: open.has("sliders verdicts"), ontoggle: (e) => keepOpen("sliders verdicts", e.target.open) }, h("summary", {}, "What the four verdicts mean"),
      h("dl", {}, Object.entries(verdict.meanings).map(([word, text]) => [h("dt", {}, word), h("dd", {}, text)]))));
}

/** A thin line: the effects tried of this pass, and the time that it still takes. */
function showSearch([asking, tried, left]) {
  $("search").hidden = !asking;
  if (!asking) return;
  const [at, of, pass] = tried.length ? tried : [0, 0, 0], bar = $("search").firstChild;
  bar.firstChild.style.width = of ? `${100 * at / of}%` : "0";
  bar.setAttribute("aria-valuemin", 0); bar.setAttribute("aria-valuemax", of || 1); bar.setAttribute("aria-valuenow", at);
  $("search").lastChild.textContent = `${state.certified ? `Search${pass ? ` ${pass}` : ""}: ${asking}` : capital(asking)}${of ? `, ${state.certified ? "effect " : ""}${Math.min(at + 1, of)} of ${of}` : ""}${left ? `, about ${left < 10 ? Math.ceil(left) : 5 * Math.ceil(left / 5)} s left of it` : ""}`;
}

/** E and nu of each model, with the interval from the data and with what may be unseen. */
function showModulus([rows, unseen]) {
  const cell = (three) => h("td", {}, three.length ? [three[0] ? h("b", {}, three[0]) : "", three[1] ? h("small", {}, `data: ${three[1]}`) : "", three[2] ? h("small", {}, three[1] ? `with unseen: ${three[2]}` : three[2]) : ""] : h("span", { class: "soft" }, "being determined"));
  fill("modulus", rows.length ? [h("h2", {}, "Young's modulus and Poisson's ratio"), h("table", {},
    h("thead", {}, h("tr", {}, ["model", "E (MPa)", "ν"].map((word) => h("th", { scope: "col" }, word)))),
    h("tbody", {}, rows.map((row) => h("tr", {}, h("th", { scope: "row" }, row.name, row.lacks ? h("small", {}, row.lacks) : ""), cell(row.modulus), cell(row.ratio))))),
    h("p", { class: "soft" }, `95 % intervals. ${unseen}`), [...new Set(rows.flatMap((row) => row.open))].map((why) => h("p", {}, why))] : "");
}

const bars = {};  // errors on the screen, by what they are of

/** The error of each model as a bar that runs from the error before to its own, with the scatter of repeats behind. */
function showFalls(falls) {
  const moved = [];
  fill("falls", falls.map((fall) => {
    const top = Math.max(...fall.error, fall.band ? fall.band[1] : 0), at = (value) => `${100 * value / top}%`;
    const before = bars[fall.of] || fall.error, [numbers, ...rest] = fall.lead.split(": ");
    bars[fall.of] = fall.error;
    return h("div", {}, h("p", { class: "lead" }, h("b", {}, numbers), rest.length ? `: ${rest.join(": ")}` : ` error of the ${fall.of}`),
      h("div", { role: "img", "aria-label": fall.lead }, fall.models.map((name, k) => {
        const start = k < before.length ? before[k] : before[before.length - 1], text = h("span", { class: "bartext", style: `left: ${at(Math.min(start, top))}` }, fall.error[k].toFixed(1));
        const bar = h("span", { class: "fill", style: `width: ${at(Math.min(start, top))}; background: ${shade(fall.colours[k])}` });
        moved.push(() => { bar.style.width = text.style.left = at(fall.error[k]); });
        return h("div", { class: "row" }, h("span", {}, name.replace("+ ", "+\u00a0")), h("span", { class: "track" }, bar,
          fall.band ? [h("span", { class: "band", style: `left: ${at(fall.band[0])}; width: ${at(fall.band[1] - fall.band[0])}` }), h("span", { class: "mark", style: `left: ${at(fall.repeatability)}` })] : "", text));
      })),
      h("p", { class: "soft" }, `${fall.note}${fall.band ? " Shaded on each bar: that scatter with its 95 % interval." : ""}`));
  }));
  requestAnimationFrame(() => requestAnimationFrame(() => moved.forEach((move) => move())));
  if (watching && matchMedia("(max-width: 760px)").matches) $("fall").scrollIntoView();
  watching = false;
}

function showComponents([components, stiffness]) {
  const lines = (one) => one.parameters.filter((p) => !p.aside).map((p) => h("div", {}, `${p.words}: ${p.text}`));
  fill("components", components.map((one) => h("div", { class: "box" },
    h("div", { class: "bar" }, h("h3", {}, one.title), one.key ? h("button", { onclick: () => { act("remove", one.key); toTop(); }, "data-remove": one.key }, "Remove") : ""),
    one.about ? h("p", { class: "soft" }, one.about) : "",
    one.key ? lines(one) : h("details", { open: open.has("sliders law"), ontoggle: (e) => keepOpen("sliders law", e.target.open) }, h("summary", {}, "More"), lines(one),
      stiffness.map((row) => h("div", {}, `${row.name}: ${row.before}${row.now === row.before ? "" : ` → ${row.now}`}`))),
    tolerances(one), sliders(one))));
}

/** What the measurements are allowed to be off by, as stated; few want to see it. */
function tolerances(component) {
  const aside = component.parameters.filter((p) => p.aside), name = `tolerances ${component.key}`;
  return !aside.length ? "" : h("details", { open: open.has(name), ontoggle: (e) => keepOpen(name, e.target.open) }, h("summary", {}, "Tolerances of the measurement"),
    aside.map((p) => h("div", { class: "soft" }, `${p.words}: ${p.text}`)));
}

/** One slider a value that is fitted; folded away, since it only shows. */
function sliders(component) {
  const moved = component.parameters.filter((p) => !p.fixed && p.low < p.high), name = `sliders ${component.key}`;
  return !moved.length ? "" : h("details", { open: open.has(name), ontoggle: (e) => keepOpen(name, e.target.open) }, h("summary", {}, "Move a value"),
    moved.map((p) => h("label", {}, p.words, h("input", { type: "range", min: p.low, max: p.high, step: (p.high - p.low) / 200, value: p.value,
      oninput: (event) => slide(p, event.target) }))),
    h("p", { class: "soft" }, "Green: with one value moved and all else held. The fit stays. ",
      h("button", { class: "link", onclick: letGo }, "Back to the fit")));
}

async function slide(parameter, input) {
  clearTimeout(sliding);
  sliding = setTimeout(async () => {
    try {
      tried = await ask(`tried?name=${encodeURIComponent(parameter.name)}&value=${encodeURIComponent(input.value)}`);
      const at = `${Number(input.value).toPrecision(4)} ${parameter.unit === "1" ? "" : parameter.unit}`, size = `${tried.rms.toFixed(1)} ${tried.unit}`;
      input.setAttribute("aria-valuetext", `${at}, residual of the fitted presses ${size}`);
      $(tried.depth ? "depth-legend" : "legend").lastChild.textContent = `slider: ${parameter.words} ${at}, residual of the fitted presses ${size}`;
      if (tried.depth) drawDepths(); else drawChosen();
    } catch (fault) { say(fault.message); }
  }, 60);
}

function letGo() {
  tried = null; drawn.components = ""; show(); if (curves) showCurves();
}

/** The error falls above: there the eye should be. */
function toTop() {
  $("fall-title").focus({ preventScroll: true });
  watching = true;
  scrollTo({ top: 0, behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "instant" : "smooth" });
}

function badge(card) {
  if (card.named) return h("span", { class: "badge bad" }, "named by the diagnosis");
  if (card.candidate) return h("span", { class: "badge bad" }, "not distinguishable");
  return card.suggested ? h("span", { class: "badge" }, "worth a try") : "";
}

function showCards([cards, earlier]) {
  const cannot = cards.filter((one) => one.why && !one.fall && one.evidence === "not tested"), lead = (one) => one.named || one.candidate;
  const near = cards.filter((one) => lead(one) || (one.fall && one.fall.share >= LITTLE)), little = cards.filter((one) => one.fall && !near.includes(one));
  const open_ = cards.filter((one) => one.significant && !one.fall && !near.includes(one)), far = cards.filter((one) => ![...cannot, ...near, ...little, ...open_].includes(one));
  const known = new Set(cards.map((one) => one.key));
  for (const key of [...open]) if (!known.has(key) && !/^sliders |^tolerances |^(near|little|open|far|cannot|weeks shut)$/.test(key)) open.delete(key);
  const folded = (name, words, some) => (some.length ? h("details", { open: open.has(name), ontoggle: (e) => keepOpen(name, e.target.open) }, h("summary", {}, `${words} (${some.length})`), some.map(cardOf)) : "");
  $("cards").className = earlier ? "stale" : "";
  fill("cards",
    earlier ? h("p", { class: "soft" }, "As tested before the last change; the new search runs.") : "",
    cards.length ? "" : h("p", { class: "soft" }, "Effects are being tested."),
    cards.length && !near.length ? h("p", {}, open_.length + little.length ? "No effect that was fitted lowers the error." : "No other effect is significant.") : "",
    near.filter((one, k) => lead(one) || k < FIRST).map(cardOf),
    folded("near", "Others that lower the error", near.filter((one, k) => !lead(one) && k >= FIRST)),
    folded("open", "Significant, not fitted", open_),
    folded("little", "Fitted, and remove next to nothing", little),
    folded("far", "May be chance", far),
    h("p", {}, h("button", { class: "link", "data-own": "card", onclick: () => editOwn(false) }, "An effect of your own…")),
    cannot.length ? h("details", { open: open.has("cannot"), ontoggle: (e) => keepOpen("cannot", e.target.open) }, h("summary", {}, `Not testable with these data (${cannot.length})`),
      cannot.map((one) => h("div", { class: "box" }, h("h3", {}, one.title), h("p", { class: "soft" }, one.why)))) : "");
  for (const node of $("cards").querySelectorAll("[data-overlay]")) drawOverlay(node, cards.find((one) => one.key === node.dataset.overlay).overlay);
}

function keepOpen(name, is) { if (is) open.add(name); else open.delete(name); }

function cardOf(card) {
  const fall = card.fall, share = fall ? Math.max(0, Math.min(1, fall.share)) : 0;
  return h("div", { class: card.named ? "box named" : "box", "data-card": card.key },
    h("div", { class: "bar" }, h("h3", {}, card.title), h("button", { class: card.named || card.candidate ? "main" : "", "data-add": card.key,
      onclick: () => { act("add", card.key); toTop(); } }, "Add")),
    card.about ? h("p", {}, card.about) : "",
    fall ? [h("div", { class: "share", role: "img", "aria-label": fall.lead }, h("span", { style: `width: ${100 * share}%` })), h("p", {}, `${fall.lead}.`)] : "",
    card.kind === "effect" ? "" : h("p", { class: "soft" }, card.kind), badge(card), card.why ? h("p", { class: "bad" }, card.why) : "",
    card.overlay ? [h("div", { class: "chart small", "data-overlay": card.key, role: "img", "aria-label": `Residual without and with ${card.title}` }),
      h("p", { class: "soft" }, h("span", { class: "dot", style: "background: var(--first)" }), "residual now; ", h("span", { class: "dot", style: "background: var(--ink)" }),
        "what it explains; ", h("span", { class: "dot", style: "background: var(--last)" }), "residual with it")]
      : !fall && !card.why ? h("button", { class: "link", onclick: () => act("card", card.key) }, "Show what it would remove") : "",
    h("details", { open: open.has(card.key), ontoggle: (e) => keepOpen(card.key, e.target.open) }, h("summary", {}, "More"),
      h("p", {}, `On ${card.of}: ${card.evidence}.`),
      card.values.length ? h("p", {}, `Fitted: ${card.values.join(", ")}`) : "",
      card.seen_in.length ? h("p", {}, `Seen against ${card.seen_in.join(", ")}.`) : "",
      card.confused_with.length ? h("p", {}, `Confused with ${card.confused_with.join(", ")}.`) : "",
      card.separated_by.length ? h("p", {}, `Distinguished by ${card.separated_by.join("; ")}.`) : "",
      card.source ? h("p", { class: "soft" }, card.source) : ""));
}

function showPresses([presses]) {
  const top = $("presses").scrollTop;
  fill("presses", presses.map((one) => {
    const fitted = one.state === "fitted";
    const words = fitted ? one.rms.map((v) => v.toFixed(1)).filter((v, k, all) => k === 0 || v !== all[0]).join(" → ") + " mN" : one.state;
    return h("div", { class: fitted || !state.certified ? "press" : "press out", "aria-current": one.name === chosen ? "true" : null },
      h("button", { onclick: () => choose(one.name, one.recording), "data-press": one.name }, h("span", {}, one.name), one.odd ? h("span", { class: "bad" }, " outlier") : "",
        h("small", {}, one.indenter), h("small", {}, words), one.why && one.rms.length > 1 && one.rms[0] !== one.rms[1] ? h("small", {}, one.why) : ""),
      !fitted && one.state !== "excluded" ? "" : h("button", { class: "link", onclick: () => act(fitted ? "leave_out" : "put_back", one.name),
        "aria-label": fitted ? `Exclude ${one.name}` : `Include ${one.name}` }, fitted ? "exclude" : "include"));
  }));
  $("presses").scrollTop = top;
  const mine = $("presses").querySelector("[aria-current=true]"), list = $("presses").getBoundingClientRect(), at = mine && mine.getBoundingClientRect();
  if (mine && (at.top < list.top || at.bottom > list.bottom)) $("presses").scrollTop = mine.offsetTop - $("presses").offsetTop;
}

function showStates([labels]) {
  const names = ["base model", "now", ...labels.map((one) => one.name)];
  const pick = (id, at) => h("select", { id }, names.map((name) => h("option", { value: name, selected: name === at }, name)));
  fill("states", h("h2", {}, "States"),
    labels.map((one) => h("div", { class: "box" }, h("div", { class: "bar" }, h("h3", {}, one.name), h("button", { onclick: () => act("restore", one.name) }, "Go to")),
      h("p", { class: "soft" }, one.effects.length ? one.effects.join(" + ") : "base model", one.left_out.length ? `; without ${one.left_out.join(", ")}` : ""))),
    h("div", { class: "line" }, h("label", {}, "Compare ", pick("side-a", "base model")), h("label", {}, "with ", pick("side-b", labels.length ? labels.at(-1).name : "now"))),
    h("button", { id: "compare", onclick: () => act("sides", `${$("side-a").value}\n${$("side-b").value}`) }, "Side by side"));
}

function showSides(sides) {
  fill("sides", sides ? h("div", { class: "box" }, h("div", { class: "bar" }, h("h2", {}, "Side by side"), h("button", { onclick: () => act("sides", "") }, "Close")),
    h("table", {}, h("thead", {}, h("tr", {}, h("th", {}, ""), sides.names.map((name) => h("th", { scope: "col" }, name)))),
      h("tbody", {}, sides.rows.map(([name, ...cells]) => h("tr", {}, h("th", { scope: "row" }, name), cells.map((cell) => h("td", {}, cell))))))) : "");
}

/** Several recordings, each fitted by itself: has the gel changed? */
function showWeeks(weeks) {
  fill("weeks", weeks.length ? h("details", { class: "box", open: !open.has("weeks shut"), ontoggle: (e) => keepOpen("weeks shut", !e.target.open) },
    h("summary", {}, "E and ν over the recordings"),
    h("div", { class: "pair" }, h("div", { id: "modulus-chart", class: "chart small" }), h("div", { id: "ratio-chart", class: "chart small" })),
    h("table", {}, h("thead", {}, h("tr", {}, ["recording", "E", "ν", "change of the stiffness c"].map((word) => h("th", { scope: "col" }, word)))),
      h("tbody", {}, weeks.map((row) => h("tr", {}, h("th", { scope: "row" }, `${row.recording} (${row.date})`), row.words.map((text) => h("td", {}, text)),
        h("td", { class: row.moved ? "bad" : "" }, `${row.change}${row.moved ? ": it has changed" : ""}`)))))) : "");
  if (weeks.length) { drawWeeks("modulus-chart", weeks, "modulus", "E (MPa)"); drawWeeks("ratio-chart", weeks, "ratio", "ν"); }
}

function choose(name) {
  chosen = name; picked = true;
  part("presses", [state.presses, chosen], showPresses);
  if (curves && curves.models.length) { drawChosen(); drawResiduals(); drawDepths(); }
  showFrames(state.presses.find((one) => one.name === name));
}

function drawDepths() {
  $("depth").hidden = !curves.depth;
  if (curves.depth) drawDepth(curves.depth, Number($("depth-against").value), chosen, tried && tried.depth, choose);
}

/** The press that the model of what fails describes worst: of the depth where that fails, else of the force. */
function worst() {
  if (curves.depth && state.falls[0].of !== "force") {
    const { read, certified, press } = curves.depth.sets[0], off = {};
    read.forEach((value, k) => { (off[press[k]] = off[press[k]] || []).push((value - certified[k]) ** 2); });
    const mean = (name) => off[name].reduce((a, b) => a + b, 0) / off[name].length;
    const known = Object.keys(off).filter((name) => curves.presses.some((one) => one.name === name));
    if (known.length) return known.reduce((a, b) => (mean(b) > mean(a) ? b : a));
  }
  return curves.presses.reduce((a, b) => (b.rms[0] > a.rms[0] ? b : a)).name;
}

function drawChosen() {
  const place = curves.presses.findIndex((one) => one.name === chosen);
  if (place < 0) {
    $("press-title").textContent = `Press ${chosen}: not fitted`;
    Plotly.purge("press-chart");
    return;
  }
  const press = curves.presses[place];
  const punch = (state.presses.find((one) => one.name === chosen) || press).indenter;
  $("press-title").textContent = `Press ${press.name}: ${punch}, rms residual ${press.rms.map((v) => v.toFixed(1)).join(" → ")} mN`;
  $("press-why").textContent = (state.presses.find((one) => one.name === chosen) || {}).why || "";
  $("against").parentNode.hidden = !curves.whole;
  if (curves.whole) drawPress(curves, press, $("against").value, tried && tried.presses[place]);
  else drawPoints(curves, chosen, tried);
}

function drawResiduals() {
  const strip = curves.strips.find((one) => one.name === $("covariate").value) || curves.strips[0];
  if (!strip) { $("strip-words").textContent = state.looked ? "Too few presses to test covariates." : "Covariates are being tested."; return; }
  $("strip-words").textContent = capital([...new Set(strip.evidence)].join(" → ")).replace("not examined", state.looked ? "not examined" : "being examined") + ". Large: means with their 95 % intervals; pale: single readings; triangles: beyond the chart; thin line or rings: the press above. Choose a point to see its press.";
  drawStrip(curves, strip, curves.strips.find((one) => one.name === $("colour").value), chosen, choose);
}

function showCurves() {
  if (!curves.models.length) return;
  const key = (colour, text) => h("span", { class: "key" }, h("span", { class: "dot", style: `background: ${colour}` }), text);
  fill("legend", key(css("--ink"), "measured"), curves.models.map((name, k) => key(shade(curves.colours[k]), name)), h("span", {}, ""));
  const options = (id, first) => {
    const before = $(id).value;
    fill(id, first, curves.strips.map((one) => h("option", { value: one.name }, one.words)));
    if ([...$(id).options].some((one) => one.value === before)) $(id).value = before;
  };
  if (curves.depth) {
    const first = curves.depth.sets[0], at = $("depth-against").value || "0", square = curves.depth.faces ? " (squares: punch faces; dots: slopes next to them)" : "";
    fill("depth-against", first.against.map((one, k) => h("option", { value: k, selected: String(k) === at }, one.words)));
    fill("depth-legend", curves.depth.sets.map((one, k) => key(css(k ? "--last" : "--first"), one.name)), `dashed: as certified${square} `, h("span", {}, ""));
  }
  options("covariate", ""); options("colour", h("option", { value: "" }, "model"));
  if (!picked || !state.presses.some((one) => one.name === chosen)) {
    chosen = worst(); picked = true;
    part("presses", [state.presses, chosen], showPresses);
    showFrames(state.presses.find((one) => one.name === chosen));
  }
  drawChosen(); drawResiduals(); drawDepths(); certify();
}

function redraw() {
  for (const name of ["falls", "cards", "weeks"]) drawn[name] = "";
  if (state) show();
  if (curves) showCurves();
  if ($("force-chart")) tell();
}

$("stop").addEventListener("click", () => act("stop"));
$("undo").addEventListener("click", () => act("undo"));
$("redo").addEventListener("click", () => act("redo"));
$("export").addEventListener("click", () => { drawn.saved = ""; exporting = true; act("export"); });
$("own-leave").addEventListener("click", () => $("own").close());
$("own-again").addEventListener("click", () => editOwn(true));
$("own-run").addEventListener("click", runOwn);
$("help").addEventListener("click", () => $("keys").showModal());
$("label").addEventListener("click", () => { $("name").value = ""; $("naming").returnValue = ""; $("naming").showModal(); });
$("leave").addEventListener("click", () => $("naming").close("cancel"));
$("naming").addEventListener("close", () => { if ($("naming").returnValue === "keep") act("label", $("name").value); });
$("against").addEventListener("change", drawChosen);
$("depth-against").addEventListener("change", drawDepths);
for (const id of ["covariate", "colour"]) $(id).addEventListener("change", drawResiduals);
DARK.addEventListener("change", redraw);
document.addEventListener("keydown", (event) => {
  if (!state || event.altKey || /^(SELECT|TEXTAREA)$/.test(event.target.tagName) || (event.target.tagName === "INPUT" && event.target.type !== "range") || document.querySelector("dialog[open]")) return;
  if (event.ctrlKey || event.metaKey) {
    const way = { z: event.shiftKey ? "redo" : "undo", y: "redo" }[event.key.toLowerCase()];
    if (way && state[way]) { event.preventDefault(); act(way); }
    return;
  }
  if (event.key === "?") $("keys").showModal();
  if (event.key === "u" && state.undo) act("undo");
  if (event.key === "r" && state.redo) act("redo");
  if ((event.key === "j" || event.key === "k") && curves) {
    const names = state.presses.map((one) => one.name), at = names.indexOf(chosen) + (event.key === "j" ? 1 : -1);
    if (names[at]) choose(names[at]);
  }
});
for (const id of ["press-chart", "strip-chart", "depth-chart"]) $(id).after(saveButton(id, $(id).getAttribute("aria-label")));
setInterval(tick, 1000);
follow();
