"use strict";
// The charts, drawn by plotly: numbers come ready from the server, nothing is computed here but places on a screen.

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

function layout(x, y, more = {}) {
  const axis = { gridcolor: css("--line"), zerolinecolor: css("--soft"), linecolor: css("--soft"), automargin: true,
    zeroline: false, fixedrange: false };
  return { margin: { l: 52, r: 8, t: 8, b: 38 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: "system-ui, sans-serif", size: 12, color: css("--ink") }, showlegend: false, hovermode: "closest",
    hoverlabel: { bgcolor: css("--panel"), font: { color: css("--ink") } }, dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom",
    ...more, xaxis: { ...axis, title: { text: x }, ...more.xaxis },
    yaxis: { ...axis, title: { text: y }, ...more.yaxis } };
}

const LEFT = "residual (mN)";  // measured minus modelled force
const PLAIN = { displaylogo: false, responsive: true, displayModeBar: false };

function draw(place, traces, shape, options = {}) {
  const node = typeof place === "string" ? document.getElementById(place) : place;
  Plotly.react(node, traces, shape, { ...PLAIN, ...options });
  return node;
}

/** Measured and modelled force of one press, and what each model leaves; `tried` from a slider. */
function drawPress(curves, press, against, tried) {
  const x = press[against], words = against === "time" ? "time (s)" : "depth w (mm)";
  const models = curves.models.map((name, k) => ({ name, colour: shade(curves.colours[k]), force: press.modelled[k], left: press.residual[k] }));
  if (tried) models.push({ name: "slider", colour: css("--good"), force: tried.modelled, left: tried.residual, dash: "dot" });
  const alone = press.time.length === 1;
  const line = (m, y) => ({ x, y, name: plain(m.name), mode: alone ? "markers" : "lines", line: { color: m.colour, width: 2, dash: m.dash },
    marker: { color: m.colour, size: 9, symbol: "line-ew-open" } });
  const measured = { x, y: press.measured, name: "measured", mode: "markers", marker: { color: css("--ink"), size: 5 } };
  draw("press-chart", [...models.map((m) => line(m, m.force)), measured], layout(words, "force (N)"));
  const left = models.map((m) => ({ ...line(m, m.left), mode: "lines+markers", marker: { color: m.colour, size: 4 } }));
  const reach = Math.max(...curves.presses.flatMap((one) => one.residual.flat()).map(Math.abs), 1e-9) * 1.05;
  draw("residual-chart", left, layout(words, LEFT, { yaxis: { range: [-reach, reach], zeroline: true } }));
}

/** Presses of one sample each: all of them over the depth, the chosen one in a ring. */
function drawPoints(curves, chosen, tried) {
  const presses = curves.presses, x = presses.map((one) => one.depth[0]), names = presses.map((one) => plain(one.name));
  const at = presses.findIndex((one) => one.name === chosen);
  const row = (name, colour, y, symbol, size) => ({ x, y, text: names, name: plain(name), mode: "markers", hovertemplate: "press %{text}<br>%{y:.4g}<extra></extra>",
    marker: { color: colour, size, symbol, line: { width: symbol === "line-ew-open" ? 2 : 0, color: colour } } });
  const ring = (y) => ({ x: [x[at]], y: [y[at]], mode: "markers", hoverinfo: "skip", marker: { size: 16, color: "rgba(0,0,0,0)", line: { width: 2, color: css("--ink") } } });
  const forces = presses.map((one) => one.measured[0]), slid = tried && tried.presses;
  draw("press-chart", [row("measured", css("--ink"), forces, "circle", 6), ...curves.models.map((name, k) => row(name, shade(curves.colours[k]), presses.map((one) => one.modelled[k][0]), "line-ew-open", 16)),
    ...(slid ? [row("slider", css("--good"), slid.map((one) => one.modelled[0]), "line-ew-open", 16)] : []), ring(forces)], layout("depth w (mm)", "force (N)"));
  const left = curves.models.map((name, k) => row(name, shade(curves.colours[k]), presses.map((one) => one.residual[k][0]), "circle", 7));
  if (slid) left.push(row("slider", css("--good"), slid.map((one) => one.residual[0]), "diamond", 7));
  draw("residual-chart", [...left, ring(presses.map((one) => one.residual[one.residual.length - 1][0]))], layout("depth w (mm)", LEFT, { yaxis: { zeroline: true } }));
}

/** Residuals of all presses against what was recorded, with the mean of each bin and its 95 % interval. */
function drawStrip(curves, strip, colourBy, chosen, onPress) {
  const traces = [], last = curves.models.length - 1;
  curves.models.forEach((name, k) => {
    const colour = shade(curves.colours[k]);
    const by = k === last ? colourBy : null;
    traces.push({ x: strip.values, y: curves.residual[k], mode: "markers", type: "scattergl" in Plotly ? "scattergl" : "scatter", name: plain(name),
      text: curves.press.map(plain), hovertemplate: "press %{text}<br>%{y:.1f} mN<extra></extra>",
      opacity: by ? 0.9 : 0.28, marker: by
        ? { size: 5, color: by.values, colorscale: "Cividis", colorbar: { title: { text: withUnit(by.words, by.unit) }, thickness: 12 } }
        : { size: 4, color: colour } });
  });
  curves.models.forEach((name, k) => {
    const colour = shade(curves.colours[k]);
    traces.push({ x: strip.centre, y: strip.mean[k], mode: "markers", name: plain(name), hoverinfo: "skip",
      error_y: { type: "data", array: strip.reach95[k], color: colour, thickness: 1.6, width: 3 },
      marker: { size: 9, color: colour, line: { width: 1, color: css("--paper") } } });
  });
  if (chosen) {
    const rows = curves.press.flatMap((one, k) => (one === chosen ? [k] : []));
    traces.push({ x: rows.map((k) => strip.values[k]), y: rows.map((k) => curves.residual[last][k]), mode: "markers", hoverinfo: "skip",
      marker: { size: 9, color: "rgba(0,0,0,0)", line: { width: 1.5, color: css("--ink") } } });
  }
  const xaxis = strip.levels.length ? { tickvals: strip.levels.map((_, k) => k), ticktext: strip.levels.map(plain) }
    : strip.unit.startsWith("log10") ? logTicks(strip.values) : strip.unit === "rad" ? QUARTERS : {};
  const rings = chosen ? curves.residual[last].filter((_, k) => curves.press[k] === chosen).map(Math.abs) : [];
  const reach = 1.1 * Math.max(1.05 * curves.reach, ...rings);
  const node = draw("strip-chart", traces, layout(withUnit(strip.words, strip.unit), LEFT,
    { xaxis, yaxis: { range: [-reach, reach], zeroline: true } }));
  node.removeAllListeners && node.removeAllListeners("plotly_click");
  node.on("plotly_click", (event) => {
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
    traces.push({ x, y, text: one.press.map(plain), mode: "markers", name: plain(one.name), hovertemplate: "press %{text}<br>%{x:.3f}, %{y:.3f}<extra></extra>",
      marker: { color: colours[k], opacity: 0.75, size: one.face.map((face) => (face ? 9 : 5)), symbol: one.face.map((face) => (face ? "square" : "circle")),
        line: { width: one.press.map((press) => (press === chosen ? 1.5 : 0)), color: css("--ink") } } });
  });
  const x = sets.flatMap((one) => one.against[against].values).filter((value) => value !== null), low = Math.min(...x), high = Math.max(...x);
  const right = whole ? [[0, high * 1.05], [0, high * 1.05]] : [[low, high], [1, 1]];
  traces.unshift({ x: right[0], y: right[1], mode: "lines", hoverinfo: "skip", line: { color: css("--soft"), width: 1.5, dash: "dash" } });
  const node = draw("depth-chart", traces, layout(plain(last.against[against].words), whole ? "depth read (mm)" : "read over certified depth"));
  node.removeAllListeners && node.removeAllListeners("plotly_click");
  node.on("plotly_click", (event) => { if (event.points[0].text) onPress(sets[event.points[0].curveNumber - 1].press[event.points[0].pointNumber]); });
}

/** What a candidate would leave: now, with it, and what it alone explains, over bins. */
function drawOverlay(place, shown) {
  const order = shown.values.map((_, k) => k).sort((a, b) => shown.values[a] - shown.values[b]);
  const pick = (row) => order.map((k) => row[k]);
  const x = pick(shown.values);
  const xaxis = shown.levels.length ? { tickvals: shown.levels.map((_, k) => k), ticktext: shown.levels.map(plain) }
    : shown.unit.startsWith("log10") ? logTicks(shown.values) : shown.unit === "rad" ? QUARTERS : { nticks: 5 };
  draw(place, [
    { x, y: pick(shown.before), mode: "markers", marker: { color: css("--first"), size: 7 } },
    { x, y: pick(shown.predicted), mode: "lines", line: { color: css("--ink"), width: 2 } },
    { x, y: pick(shown.after), mode: "markers", marker: { color: css("--last"), size: 7, symbol: "square" } },
  ], layout(withUnit(shown.words, shown.unit), LEFT, { margin: { l: 40, r: 4, t: 4, b: 34 }, dragmode: false, hovermode: false,
    xaxis: { ...xaxis, fixedrange: true }, yaxis: { zeroline: true, nticks: 4, fixedrange: true } }), { staticPlot: true });
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

/** The force during a press, where its bevel touches, and the frame that is shown. */
function drawTouch(place, found, shown) {
  const upright = (x, colour, dash) => ({ type: "line", yref: "paper", y0: 0, y1: 1, x0: x, x1: x, line: { color: css(colour), width: 2, dash } });
  const touched = found.event_s === null ? [] : [upright(found.event_s, "--bad", "dash")];
  draw(place, [{ x: found.force_s, y: found.force_N, mode: "lines", line: { color: css("--ink"), width: 1.5 } }],
    layout("time (s)", "force (N)", { shapes: [...touched, upright(shown, "--last", "solid")],
      annotations: touched.map((one) => ({ x: one.x0, y: 1, yref: "paper", text: "touch", showarrow: false, xanchor: "right", font: { color: css("--bad") } })) }));
}
