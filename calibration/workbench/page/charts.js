"use strict";
// The charts, drawn by plotly: numbers come ready from the server, nothing is computed here but places on a screen.

const NARROW = matchMedia("(max-width: 760px)");
const DARK = matchMedia("(prefers-color-scheme: dark)");
const LIGHTER = { "#D55E00": "#ff8a3d", "#0072B2": "#3f98e0", "#56B4E9": "#b5e0fb", "#767676": "#a5a5a5" };

/** A colour of the reports as it is seen on today's background. */
function shade(colour) { return DARK.matches ? LIGHTER[colour] || colour : colour; }

function css(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }

/** Ticks of a direction, in degrees. */
const QUARTERS = { tickvals: [-2, -1, 0, 1, 2].map((k) => k * Math.PI / 2), ticktext: ["-180", "-90", "0", "90", "180"] };

/** Text for plotly, which reads some tags: a name shows as it is written. */
function plain(text) { return String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;"); }

function withUnit(words, unit) {
  const shown = unit === "rad" ? "°" : unit.replace("log10 ", "");
  return plain(shown && shown !== "1" ? `${words} (${shown})` : words);
}

/** Ticks of a covariate in the unit that it names: names of categories, logarithms as numbers, directions in degrees. */
function ticks(one) {
  return one.levels.length ? { tickvals: one.levels.map((_, k) => k), ticktext: one.levels.map(plain) }
    : one.unit.startsWith("log10") ? logTicks(one.values) : one.unit === "rad" ? QUARTERS : {};
}

/** A value of a covariate as text, in its unit. */
function inUnit(one, value) {
  if (one.levels.length) return plain(one.levels[value] || value);
  const [shown, unit] = one.unit === "rad" ? [value * 180 / Math.PI, "°"] : one.unit.startsWith("log10") ? [10 ** value, one.unit.replace("log10 ", "")] : [value, one.unit];
  return plain(`${Number(shown.toPrecision(3))} ${unit === "1" ? "" : unit}`.trim());
}

function layout(x, y, more = {}) {
  const axis = { gridcolor: css("--line"), zerolinecolor: css("--soft"), linecolor: css("--soft"), automargin: true,
    zeroline: false, fixedrange: false };
  const two = more.yaxis2 ? { yaxis2: { ...axis, zeroline: true, ...more.yaxis2 } } : {};
  return { margin: { l: 52, r: 8, t: 8, b: 38 }, paper_bgcolor: css("--paper"), plot_bgcolor: css("--paper"),
    font: { family: "system-ui, sans-serif", size: 12, color: css("--ink") }, showlegend: false, hovermode: "closest",
    hoverlabel: { bgcolor: css("--panel"), font: { color: css("--ink") } }, dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom",
    ...more, xaxis: { ...axis, title: { text: x }, ...more.xaxis },
    yaxis: { ...axis, title: { text: y }, ...more.yaxis }, ...two };
}

const LEFT = "residual (mN)";  // measured minus modelled force
const PLAIN = { displaylogo: false, responsive: true, displayModeBar: false };
const ABOVE = { domain: [0.42, 1] }, BELOW = { domain: [0, 0.36] };  // two charts over one axis, which they share
const CATEGORY = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"];  // Okabe and Ito's, told apart by all
const FEW = 6;  // distinct values that are shown as categories

function draw(place, traces, shape, options = {}) {
  const node = typeof place === "string" ? document.getElementById(place) : place;
  Plotly.react(node, traces, shape, { ...PLAIN, ...options });
  return node;
}

/** Call this alone on an event of a chart, which outlives what it draws. */
function listen(node, name, act) {
  node.removeAllListeners(name);
  node.on(name, act);
}

/** A chart with a name for those who do not see it, and a button that saves its picture. */
function chartOf(id, label, kind = "") {
  return h("figure", { class: "chart-of" }, h("div", { id, class: `chart ${kind}`, role: "img", "aria-label": label }), saveButton(id, label));
}

function saveButton(id, label) {
  return h("button", { class: "link save", "aria-label": `Save picture: ${label}`,
    onclick: () => Plotly.downloadImage(document.getElementById(id), { format: "png", scale: 2, filename: `${document.title.split(" – ")[0]}_${id}`.replace(/\W+/g, "_") }) }, "Save picture");
}

/** Measured and modelled force of one press over what each model leaves, on one axis; `tried` from a slider. */
function drawPress(curves, press, against, tried) {
  const x = press[against], words = against === "time" ? "time (s)" : "depth w (mm)";
  const models = curves.models.map((name, k) => ({ name, colour: shade(curves.colours[k]), force: press.modelled[k], left: press.residual[k] }));
  if (tried) models.push({ name: "slider", colour: css("--good"), force: tried.modelled, left: tried.residual, dash: "dot" });
  const alone = press.time.length === 1;
  const line = (m, y, unit) => ({ x, y, name: plain(m.name), mode: alone ? "markers" : "lines", line: { color: m.colour, width: 2, dash: m.dash }, hovertemplate: `%{x:.4g}: %{y:.4g} ${unit}<extra>${plain(m.name)}</extra>`,
    marker: { color: m.colour, size: 9, symbol: "line-ew-open" } });
  const measured = { x, y: press.measured, text: press.phase, name: "measured", mode: "markers", marker: { color: css("--ink"), size: 5 }, hovertemplate: "%{x:.4g}: %{y:.4g} N, %{text}<extra>measured</extra>" };
  const left = models.map((m) => ({ ...line(m, m.left, "mN"), yaxis: "y2", mode: "lines+markers", marker: { color: m.colour, size: 4 } }));
  const reach = Math.max(...curves.presses.flatMap((one) => one.residual.flat()).map(Math.abs), 1e-9) * 1.05;
  draw("press-chart", [...models.map((m) => line(m, m.force, "N")), measured, ...left], layout(words, "force (N)", { yaxis: ABOVE, xaxis: { anchor: "y2" }, yaxis2: { ...BELOW, title: { text: LEFT }, range: [-reach, reach] } }));
}

/** Presses of one sample each: all of them over the depth, the chosen one in a ring. */
function drawPoints(curves, chosen, tried) {
  const presses = curves.presses, x = presses.map((one) => one.depth[0]), names = presses.map((one) => plain(one.name));
  const at = presses.findIndex((one) => one.name === chosen);
  const row = (name, colour, y, symbol, size, yaxis) => ({ x, y, yaxis, text: names, name: plain(name), mode: "markers", hovertemplate: `press %{text}<br>%{y:.4g} ${yaxis === "y" ? "N" : "mN"}<extra>${plain(name)}</extra>`,
    marker: { color: colour, size, symbol, line: { width: symbol === "line-ew-open" ? 2 : 0, color: colour } } });
  const ring = (y, yaxis) => ({ x: [x[at]], y: [y[at]], yaxis, mode: "markers", hoverinfo: "skip", marker: { size: 16, color: "rgba(0,0,0,0)", line: { width: 2, color: css("--ink") } } });
  const forces = presses.map((one) => one.measured[0]), slid = tried && tried.presses;
  const left = curves.models.map((name, k) => row(name, shade(curves.colours[k]), presses.map((one) => one.residual[k][0]), "circle", 7, "y2"));
  if (slid) left.push(row("slider", css("--good"), slid.map((one) => one.residual[0]), "diamond", 7, "y2"));
  draw("press-chart", [row("measured", css("--ink"), forces, "circle", 6, "y"), ...curves.models.map((name, k) => row(name, shade(curves.colours[k]), presses.map((one) => one.modelled[k][0]), "line-ew-open", 16, "y")),
    ...(slid ? [row("slider", css("--good"), slid.map((one) => one.modelled[0]), "line-ew-open", 16, "y")] : []), ring(forces, "y"),
    ...left, ring(presses.map((one) => one.residual[one.residual.length - 1][0]), "y2")],
  layout("depth w (mm)", "force (N)", { yaxis: ABOVE, xaxis: { anchor: "y2" }, yaxis2: { ...BELOW, title: { text: LEFT } } }));
}

/** Whether a covariate has so few values that each is a strip and a colour of its own. */
function few(one) { return new Set(one.values).size <= FEW; }

/** How points are coloured by a covariate, and the empty points that name its categories in a legend. */
function colouring(by) {
  if (!by) return { marker: {}, names: [] };
  if (!few(by)) return { marker: { color: by.values, colorscale: "Cividis", colorbar: { title: { text: withUnit(by.words, by.unit) }, thickness: 12, ...ticks(by) } }, names: [] };
  const values = [...new Set(by.values)].sort((a, b) => a - b), colour = (value) => CATEGORY[values.indexOf(value)];
  return { marker: { color: by.values.map(colour) },
    names: values.map((value) => ({ x: [null], y: [null], mode: "markers", showlegend: true, name: inUnit(by, value), marker: { size: 9, color: colour(value) } })) };
}

/** Residuals of all presses against what was recorded, with the mean of each bin and its 95 % interval; the chosen press as a line. */
function drawStrip(curves, strip, colourBy, chosen, onPress) {
  const traces = [], last = curves.models.length - 1, { marker, names } = colouring(colourBy), reach = 1.1 * 1.05 * curves.reach;
  const values = [...new Set(strip.values)].sort((a, b) => a - b), apart = values.length > 1 && few(strip) ? Math.min(...values.slice(1).map((v, k) => v - values[k])) : 0;
  const aside = (k, row) => 0.32 * apart * ((k - last / 2) / Math.max(last, 1) + 0.7 * (((row * 0.618) % 1) - 0.5));  // strips of one value: models side by side, spread
  const place = (k) => strip.values.map((value, row) => (apart && value !== null ? value + aside(k, row) : value));
  const within = (y) => Math.max(-reach, Math.min(reach, y)) * 0.985;
  curves.models.forEach((name, k) => {
    const by = k === last && colourBy, size = by ? 5 : 4, y = curves.residual[k], out = y.map((one) => Math.abs(one) > reach);
    traces.push({ x: place(k), y: y.map((one, row) => (out[row] ? within(one) : one)), customdata: y, mode: "markers", name: plain(name), showlegend: false,
      text: curves.press.map((one, row) => `press ${plain(one)}<br>${plain(strip.words)} ${inUnit(strip, strip.values[row])}${by ? `<br>${plain(by.words)} ${inUnit(by, by.values[row])}` : ""}`),
      hovertemplate: "%{text}<br>%{customdata:.1f} mN<extra></extra>", opacity: by ? 0.9 : Math.max(0.28, Math.min(0.9, 60 / y.length)),
      marker: { color: shade(curves.colours[k]), ...(by ? marker : {}), line: { width: 0 }, size: out.map((one) => (one ? 9 : size)), symbol: y.map((one, row) => (out[row] ? (one > 0 ? "triangle-up" : "triangle-down") : "circle")) } });
  });
  curves.models.forEach((name, k) => {
    const colour = shade(curves.colours[k]), shift = apart ? 0.32 * apart * (k - last / 2) / Math.max(last, 1) : 0;
    traces.push({ x: strip.centre.map((value) => value + shift), y: strip.mean[k], mode: "markers", name: plain(name), showlegend: false, hovertemplate: `mean %{y:.1f} mN<extra>${plain(name)}</extra>`,
      error_y: { type: "data", array: strip.reach95[k], color: colour, thickness: 1.6, width: 3 },
      marker: { size: 9, color: colour, line: { width: 1, color: css("--paper") } } });
  });
  if (chosen) {
    const rows = curves.press.flatMap((one, k) => (one === chosen ? [k] : []));
    const shift = apart ? 0.16 * apart * Math.min(last, 1) : 0;
    traces.push({ x: rows.map((k) => strip.values[k] + shift), showlegend: false, y: rows.map((k) => within(curves.residual[last][k]) / 0.985), mode: rows.length > 1 && !apart ? "lines" : "markers", hoverinfo: "skip",
      line: { color: css("--ink"), width: 1 }, marker: { size: rows.length > 1 ? 6 : 11, color: "rgba(0,0,0,0)", line: { width: rows.length > 1 ? 1 : 1.5, color: css("--ink") } } });
  }
  const node = draw("strip-chart", [...traces, ...names], layout(withUnit(strip.words, strip.unit), LEFT,
    { xaxis: ticks(strip), yaxis: { range: [-reach, reach], zeroline: true }, showlegend: names.length > 0, legend: { title: { text: names.length ? withUnit(colourBy.words, "") : "" }, ...(NARROW.matches ? { orientation: "h", y: -0.25 } : {}) } }));
  listen(node, "plotly_click", (event) => {
    const point = event.points.find((one) => one.text !== undefined);
    if (point) onPress(curves.press[point.pointNumber]);
  });
}

/** Ticks at round numbers on an axis that is a logarithm already. */
function logTicks(values) {
  const low = values.reduce((a, b) => Math.min(a, b)), high = values.reduce((a, b) => Math.max(a, b));
  const ticks = [];
  for (let k = Math.floor(low); k <= Math.ceil(high); k++) for (const step of high - low > 2 ? [1] : [1, 2, 5]) {
    const at = k + Math.log10(step);
    if (at >= low && at <= high) ticks.push([at, Number((step * 10 ** k).toPrecision(3))]);
  }
  return { tickvals: ticks.map((t) => t[0]), ticktext: ticks.map((t) => String(t[1])) };
}

/** What pictures read against the certified depth (or, against anything else, their ratio), before and after; `tried` from a slider. */
function drawDepth(depth, against, chosen, tried, onPress) {
  const whole = against === 0, traces = [], last = depth.sets[depth.sets.length - 1];
  const sets = tried ? [...depth.sets, { ...last, name: "slider", read: tried }] : depth.sets;
  const colours = [css("--first"), depth.sets.length > 1 ? css("--last") : css("--good"), css("--good")];
  sets.forEach((one, k) => {
    const aside = whole ? (k - (sets.length - 1) / 2) * 0.012 * Math.max(...one.certified) : 0;  // before and after next to each other
    const x = one.against[against].values.map((value) => (value === null ? null : value + aside)), y = one.read.map((read, j) => (whole ? read : read / one.certified[j]));
    traces.push({ x, y, text: one.press.map(plain), mode: "markers", name: plain(one.name), hovertemplate: `press %{text}<br>%{x:.3f}: %{y:.3f}${whole ? " mm read" : " of the certified depth"}<extra>${plain(one.name)}</extra>`,
      marker: { color: colours[k], opacity: 0.75, size: one.face.map((face) => (face ? 9 : 5)), symbol: one.face.map((face) => (face ? "square" : "circle")),
        line: { width: one.press.map((press) => (press === chosen ? 1.5 : 0)), color: css("--ink") } } });
  });
  const x = sets.flatMap((one) => one.against[against].values).filter((value) => value !== null), low = Math.min(...x), high = Math.max(...x);
  const right = whole ? [[0, high * 1.05], [0, high * 1.05]] : [[low, high], [1, 1]];
  traces.unshift({ x: right[0], y: right[1], mode: "lines", hoverinfo: "skip", line: { color: css("--soft"), width: 1.5, dash: "dash" } });
  const node = draw("depth-chart", traces, layout(plain(last.against[against].words), whole ? "depth read (mm)" : "read over certified depth"));
  listen(node, "plotly_click", (event) => { if (event.points[0].text) onPress(sets[event.points[0].curveNumber - 1].press[event.points[0].pointNumber]); });
}

/** What a candidate would leave: now, with it, and what it alone explains, over bins. */
function drawOverlay(place, shown) {
  const order = shown.values.map((_, k) => k).sort((a, b) => shown.values[a] - shown.values[b]);
  const pick = (row) => order.map((k) => row[k]), x = pick(shown.values), hovertemplate = "%{y:.1f} mN<extra>%{fullData.name}</extra>";
  draw(place, [
    { x, y: pick(shown.before), name: "now", hovertemplate, mode: "markers", marker: { color: css("--first"), size: 7 } },
    { x, y: pick(shown.predicted), name: "explained", hovertemplate, mode: "lines", line: { color: css("--ink"), width: 2 } },
    { x, y: pick(shown.after), name: "with it", hovertemplate, mode: "markers", marker: { color: css("--last"), size: 7, symbol: "square" } },
  ], layout(withUnit(shown.words, shown.unit), LEFT, { margin: { l: 40, r: 4, t: 4, b: 34 }, dragmode: false,
    xaxis: { nticks: 5, ...ticks(shown), fixedrange: true }, yaxis: { zeroline: true, nticks: 4, fixedrange: true } }));
}

/** One quantity of each recording with its 95 % interval, by date. */
function drawWeeks(place, weeks, name, words) {
  const known = weeks.filter((row) => row[name].value !== null);
  draw(place, [{ x: known.map((row) => plain(row.date)), y: known.map((row) => row[name].value), mode: "markers", hoverinfo: "x+y",
    error_y: { type: "data", symmetric: false, array: known.map((row) => (row[name].interval95 ? row[name].interval95[1] - row[name].value : 0)),
      arrayminus: known.map((row) => (row[name].interval95 ? row[name].value - row[name].interval95[0] : 0)), color: css("--last") },
    marker: { size: 9, color: css("--last") } }],
  layout("", words, { dragmode: false, xaxis: { type: "category", fixedrange: true }, yaxis: { fixedrange: true } }));
}

/** The force during a press and the depth read by the camera on one axis, where its bevel touches, and the frame that is shown. */
function drawTouch(place, found, shown) {
  const upright = (x, colour, dash) => ({ type: "line", yref: "paper", y0: 0, y1: 1, x0: x, x1: x, line: { color: css(colour), width: 2, dash } });
  const touched = found.event_s === null ? [] : [upright(found.event_s, "--bad", "dash")];
  const node = draw(place, [{ x: found.force_s, y: found.force_N, mode: "lines", line: { color: css("--ink"), width: 1.5 }, hovertemplate: "%{x:.2f} s: %{y:.3f} N<extra></extra>" },
    { x: found.depth_s, y: found.depth_mm, yaxis: "y2", mode: "lines+markers", line: { color: css("--first"), width: 1.5 }, marker: { size: 4 }, hovertemplate: "%{x:.2f} s: %{y:.3f} mm read<extra></extra>" }],
  layout("time (s)", "force (N)", { xaxis: { anchor: "y2" }, yaxis: { domain: [0.54, 1] }, yaxis2: { domain: [0, 0.46], title: { text: "depth (mm)" }, autorange: "reversed" }, shapes: [...touched, upright(shown, "--last", "solid")],
    annotations: touched.map((one) => ({ x: one.x0, y: 1, yref: "paper", text: "touch", showarrow: false, xanchor: "right", font: { color: css("--bad") } })) }));
  listen(node, "plotly_hover", (event) => seekTime(event.points[0].x, false));
  listen(node, "plotly_click", (event) => seekTime(event.points[0].x, true));
}
