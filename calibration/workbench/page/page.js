"use strict";
// The page: shows what the server says stands, and hands over what a person does. It holds no physics and no statistics.

const $ = (id) => document.getElementById(id);
let state = null, curves = null, model = null, chosen = null, tried = null, seenSince = 0, sliding = null, watching = false;
const FIRST = 4;  // cards that are shown at once
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
  say("");
  try {
    const answer = await fetch("act", { method: "POST", headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ action, value, version: state.version }) });
    if (!answer.ok) say((await answer.json()).error);
  } catch { say("The workbench does not answer: was it ended? What was kept is in its folder."); }
}

async function follow() {
  for (;;) {
    try {
      const news = await ask(`state?since=${state ? state.version : 0}`);
      state = news;
      seenSince = performance.now() - 1000 * news.busy_s;
      show();
      if (news.model !== model) {
        const wanted = news.model;
        curves = await ask("curves");
        model = wanted; tried = null;
        showCurves();
      }
    } catch (fault) {
      $("busy").textContent = "The workbench does not answer: was it ended? Its state is kept in its folder.";
      await new Promise((done) => setTimeout(done, 2000));
    }
  }
}

function show() {
  document.title = `${state.title} – workbench`;
  $("title").textContent = state.title;
  $("undo").disabled = !state.undo; $("redo").disabled = !state.redo;
  $("label").disabled = $("export").disabled = !state.components.length;
  if (state.notice) say(state.notice);
  if (state.saved) part("saved", state.saved, (saved) => say(`Written: ${saved}, with calibration.json and repeat.sh beside it.`));
  part("warnings", state.warnings, (warnings) => fill("warnings", warnings.map((text) => h("li", {}, `${/^\S*\./.test(text) ? text[0] : text[0].toUpperCase()}${text.slice(1)}.`.replace(/\.\.$/, ".")))));
  tick();
  part("verdict", [state.verdict, state.falls.map((f) => [f.sentence, f.reached]), state.material[0]], showVerdict);
  part("falls", state.falls, showFalls);
  part("components", [state.components, state.material], showComponents);
  part("cards", [state.cards, state.verdict.word], showCards);
  part("presses", [state.presses, chosen], showPresses);
  part("states", [state.labels, state.components.map((c) => c.key)], showStates);
  part("sides", state.sides, showSides);
  part("weeks", state.weeks, showWeeks);
}

function tick() {
  const seconds = state && state.busy ? (performance.now() - seenSince) / 1000 : 0;
  $("busy").className = state && state.busy ? "on" : "";
  $("stop").hidden = !(state && state.busy && state.stoppable && seconds > 1);
  $("busy").textContent = state && state.busy ? `${state.busy}${seconds > 1 ? `, ${seconds.toFixed(0)} s` : ""}` : "";
}

function showVerdict([verdict, falls, modulus]) {
  const withWords = verdict.with.length ? `With ${verdict.with.join(" and ")} in the model` : "With the base model alone";
  const clean = verdict.word === "ADEQUATE" && falls.every(([, reached]) => reached);
  $("verdict").className = verdict.word ? (clean ? "clean" : "found") : "";
  fill("verdict",
    verdict.word ? h("p", { class: "lead" }, h("b", {}, verdict.word), `. ${verdict.sentence}`)
      : h("p", { class: "lead" }, verdict.troubled ? `No verdict: ${verdict.troubled}` : "Looking for what is missing",
        verdict.asking ? h("span", { class: "soft" }, ` (${verdict.asking} …)`) : ""),
    verdict.named.length ? h("p", {}, verdict.named.map((one) => h("button", { class: "main", "data-cure": one.key,
      onclick: () => { act("add", one.key); toTop(); } }, `Add ${one.title}`)), " and watch the error fall.") : "",
    verdict.nearest.length ? h("p", {}, verdict.nearest.map((one) => h("button", { class: "main", "data-cure": one.key,
      onclick: () => { act("add", one.key); toTop(); } }, `Try ${one.title}`)), " and see whether the error falls.") : "",
    h("p", { class: "soft" }, `${withWords}.`),
    falls.map(([sentence, reached]) => h("p", { class: clean && reached ? "good" : "" }, sentence)),
    modulus ? h("p", {}, `${modulus.name}: ${modulus.before}${modulus.now === modulus.before ? "" : ` → ${modulus.now}`}`) : "",
    verdict.remarks.map((text) => h("p", { class: "soft" }, text)),
    verdict.next.length ? [h("h2", {}, "Measure next"), h("ul", {}, verdict.next.slice(0, 3).map((one) => h("li", {}, `${one.action} (${one.minutes} minutes`,
      one.gain ? `, expected to separate the candidates by ${one.gain} std)` : ")")))] : "");
}

function showFalls(falls) {
  fill("falls", falls.map((fall) => [h("div", { class: "chart fall", role: "img", "aria-label": fall.sentence }),
    h("p", { class: "soft" }, `Error of ${fall.of} on ${fall.held_out ? "held-out" : "fitted"} presses. Dashed: repeatability`,
      fall.band ? ", shaded its 95 % interval." : ".")]));
  [...$("falls").querySelectorAll(".chart")].forEach((node, k) => drawFall(node, falls[k]));
  if (watching && matchMedia("(max-width: 760px)").matches) $("fall").scrollIntoView();
  watching = false;
}

function showComponents([components, material]) {
  fill("components", components.map((one) => h("div", { class: "box" },
    h("div", { class: "bar" }, h("h3", {}, one.title), one.key ? h("button", { onclick: () => { act("remove", one.key); toTop(); }, "data-remove": one.key }, "Remove") : ""),
    one.about ? h("p", { class: "soft" }, one.about) : "",
    one.parameters.filter((p) => !p.aside).map((p) => h("div", {}, `${p.words}: ${p.text}`)), tolerances(one), sliders(one))));
  fill("material", material.length ? h("details", { open: open.has("sliders gel"), ontoggle: (e) => keepOpen("sliders gel", e.target.open) }, h("summary", {}, "What it says of the gel"), h("table", {},
    h("thead", {}, h("tr", {}, h("th", {}, ""), h("th", { scope: "col" }, "base model"), h("th", { scope: "col" }, "now"))),
    h("tbody", {}, material.map((row) => h("tr", {}, h("th", { scope: "row" }, row.name), h("td", {}, row.before), h("td", {}, row.now)))))) : "");
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
    h("p", { class: "soft" }, "The dotted green line is the force with one value moved and all else held. The fit stays. ",
      h("button", { class: "link", onclick: letGo }, "Back to the fit")));
}

async function slide(parameter, input) {
  clearTimeout(sliding);
  sliding = setTimeout(async () => {
    try {
      tried = await ask(`tried?name=${encodeURIComponent(parameter.name)}&value=${encodeURIComponent(input.value)}`);
      input.setAttribute("aria-valuetext", `${Number(input.value).toPrecision(4)} ${parameter.unit}, rms ${tried.rms.toFixed(1)} mN`);
      $("legend").lastChild.textContent = `slider: ${parameter.words} ${Number(input.value).toPrecision(4)} ${parameter.unit === "1" ? "" : parameter.unit}, rms of all presses ${tried.rms.toFixed(1)} mN`;
      drawChosen();
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
  if (card.candidate) return h("span", { class: "badge bad" }, "cannot be told apart");
  return card.suggested ? h("span", { class: "badge" }, "worth a try") : "";
}

function showCards([cards, word]) {
  const far = cards.filter((one) => !one.significant && !one.why), cannot = cards.filter((one) => one.why && one.evidence === "not tested");
  const weak = word === "ADEQUATE" || word === "IDENTIFIED" ? cards.filter((one) => one.significant && !one.named && !one.candidate) : [];
  const near = cards.filter((one) => !far.includes(one) && !cannot.includes(one) && !weak.includes(one));
  const known = new Set(cards.map((one) => one.key));
  for (const key of [...open]) if (!known.has(key) && !/^sliders |^tolerances |^(near|weak|far|cannot|weeks shut)$/.test(key)) open.delete(key);
  fill("cards",
    cards.length ? "" : h("p", { class: "soft" }, "Effects are being tested."),
    cards.length && !near.length ? h("p", {}, weak.length ? "The diagnosis names nothing more." : "No other effect is significant.") : "",
    near.slice(0, FIRST).map(cardOf),
    near.length > FIRST ? h("details", { open: open.has("near"), ontoggle: (e) => keepOpen("near", e.target.open) }, h("summary", {}, `Others that stand out (${near.length - FIRST})`), near.slice(FIRST).map(cardOf)) : "",
    weak.length ? h("details", { open: open.has("weak"), ontoggle: (e) => keepOpen("weak", e.target.open) }, h("summary", {}, `Stand out, but the diagnosis does not name them (${weak.length})`), weak.map(cardOf)) : "",
    far.length ? h("details", { open: open.has("far"), ontoggle: (e) => keepOpen("far", e.target.open) }, h("summary", {}, `May be chance (${far.length})`), far.map(cardOf)) : "",
    cannot.length ? h("details", { open: open.has("cannot"), ontoggle: (e) => keepOpen("cannot", e.target.open) }, h("summary", {}, `Not testable with these data (${cannot.length})`),
      cannot.map((one) => h("div", { class: "box" }, h("h3", {}, one.title), h("p", { class: "soft" }, one.why)))) : "");
  for (const node of $("cards").querySelectorAll("[data-overlay]")) drawOverlay(node, cards.find((one) => one.key === node.dataset.overlay).overlay);
}

function keepOpen(name, is) { if (is) open.add(name); else open.delete(name); }

function cardOf(card) {
  return h("div", { class: card.named ? "box named" : "box", "data-card": card.key },
    h("div", { class: "bar" }, h("h3", {}, card.title), h("button", { class: card.named || card.candidate ? "main" : "", "data-add": card.key,
      onclick: () => { act("add", card.key); toTop(); } }, "Add")),
    card.about ? h("p", {}, card.about) : "",
    h("p", { class: card.significant ? "" : "soft" }, card.evidence, card.kind === "effect" ? "" : ` · ${card.kind}`, card.of === "the force" ? "" : ` · acts on ${card.of}`, " ", badge(card)),
    card.why ? h("p", { class: "bad" }, card.why) : "",
    card.overlay ? [h("div", { class: "chart small", "data-overlay": card.key, role: "img", "aria-label": `What ${card.title} would leave` }),
      h("p", { class: "soft" }, h("span", { class: "dot", style: "background: var(--first)" }), "left now; ", h("span", { class: "dot", style: "background: var(--ink)" }),
        "what it explains; ", h("span", { class: "dot", style: "background: var(--last)" }), "left with it. ",
        card.rms ? `Error of the presses fitted ${card.rms[0].toFixed(1)} → ${card.rms[1].toFixed(1)} mN.` : "")]
      : card.of === "the force" && !card.why ? h("button", { class: "link", onclick: () => act("card", card.key) }, "Show what it would leave") : "",
    h("details", { open: open.has(card.key), ontoggle: (e) => keepOpen(card.key, e.target.open) }, h("summary", {}, "More"),
      card.values.length ? h("p", {}, `Fitted: ${card.values.join(", ")}`) : "",
      card.seen_in.length ? h("p", {}, `Seen against ${card.seen_in.join(", ")}.`) : "",
      card.confused_with.length ? h("p", {}, `Confused with ${card.confused_with.join(", ")}.`) : "",
      card.separated_by.length ? h("p", {}, `Told apart by ${card.separated_by.join("; ")}.`) : "",
      card.source ? h("p", { class: "soft" }, card.source) : ""));
}

function showPresses([presses]) {
  const top = $("presses").scrollTop;
  fill("presses", presses.map((one) => {
    const fitted = one.state === "fitted", rejected = one.state.startsWith("rejected");
    const words = fitted ? one.rms.map((v) => v.toFixed(1)).filter((v, k, all) => k === 0 || v !== all[0]).join(" → ") + " mN" : one.state;
    return h("div", { class: fitted ? "press" : "press out", "aria-current": one.name === chosen ? "true" : null },
      h("button", { onclick: () => choose(one.name, one.recording), "data-press": one.name }, h("span", {}, one.name), one.odd ? h("span", { class: "bad" }, " outlier") : "",
        h("small", {}, one.indenter), h("small", {}, words)),
      rejected ? "" : h("button", { class: "link", onclick: () => act(fitted ? "leave_out" : "put_back", one.name),
        "aria-label": fitted ? `Leave out ${one.name}` : `Put back ${one.name}` }, fitted ? "leave out" : "put back"));
  }));
  $("presses").scrollTop = top;
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
  chosen = name;
  part("presses", [state.presses, chosen], showPresses);
  drawChosen(); drawResiduals();
  showFrames(state.presses.find((one) => one.name === name));
}

function drawChosen() {
  const place = curves.presses.findIndex((one) => one.name === chosen);
  if (place < 0) {
    $("press-title").textContent = `Press ${chosen}: not fitted`;
    Plotly.purge("press-chart"); Plotly.purge("residual-chart");
    return;
  }
  const press = curves.presses[place];
  const punch = (state.presses.find((one) => one.name === chosen) || press).indenter;
  $("press-title").textContent = `Press ${press.name}: ${punch}, rms ${press.rms.map((v) => v.toFixed(1)).join(" → ")} mN`;
  $("against").parentNode.hidden = !curves.whole;
  if (curves.whole) drawPress(curves, press, $("against").value, tried && tried.presses[place]);
  else drawPoints(curves, chosen, tried);
}

function drawResiduals() {
  const strip = curves.strips.find((one) => one.name === $("covariate").value) || curves.strips[0];
  if (!strip) { $("strip-words").textContent = state.looked ? "Too few presses to test covariates." : "Covariates are being tested."; return; }
  $("strip-words").textContent = [...new Set(strip.evidence)].join(" → ") + ". Large: means with their 95 % intervals; pale: single readings; rings: the press above. Choose a point to see its press.";
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
  options("covariate", ""); options("colour", h("option", { value: "" }, "model"));
  if (!curves.presses.some((one) => one.name === chosen)) {
    chosen = curves.presses.reduce((a, b) => (b.rms[0] > a.rms[0] ? b : a)).name;
    part("presses", [state.presses, chosen], showPresses);
    showFrames(state.presses.find((one) => one.name === chosen));
  }
  drawChosen(); drawResiduals();
}

function redraw() {
  for (const name of ["falls", "cards", "weeks"]) drawn[name] = "";
  if (state) show();
  if (curves) showCurves();
}

$("stop").addEventListener("click", () => act("stop"));
$("undo").addEventListener("click", () => act("undo"));
$("redo").addEventListener("click", () => act("redo"));
$("export").addEventListener("click", () => { drawn.saved = ""; act("export"); });
$("label").addEventListener("click", () => { $("name").value = ""; $("naming").returnValue = ""; $("naming").showModal(); });
$("leave").addEventListener("click", () => $("naming").close("cancel"));
$("naming").addEventListener("close", () => { if ($("naming").returnValue === "keep") act("label", $("name").value); });
$("against").addEventListener("change", drawChosen);
for (const id of ["covariate", "colour"]) $(id).addEventListener("change", drawResiduals);
DARK.addEventListener("change", redraw);
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || /INPUT|SELECT|TEXTAREA/.test(event.target.tagName) || $("naming").open) return;
  if (event.key === "u" && state.undo) act("undo");
  if (event.key === "r" && state.redo) act("redo");
  if ((event.key === "j" || event.key === "k") && curves) {
    const names = state.presses.map((one) => one.name), at = names.indexOf(chosen) + (event.key === "j" ? 1 : -1);
    if (names[at]) choose(names[at]);
  }
});
setInterval(tick, 1000);
follow();
