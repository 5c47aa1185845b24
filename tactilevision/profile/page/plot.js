"use strict";
// The section through a ball: depth that was read, and the ball's own, over the place along x.

function sharpen(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.height = height + "px";
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  return pen;
}

function step(range) {
  const raw = range / 4, power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((one) => one * power >= raw);
}

function drawSection(canvas, section) {
  const width = canvas.clientWidth, height = 190, left = 58, right = 8, top = 8, bottom = 34;
  const pen = sharpen(canvas, width, height);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, sans-serif";
  pen.fillStyle = "#667085";
  if (!section.x_mm) {
    pen.textAlign = "center";
    pen.fillText("not used by the last fit", width / 2, height / 2);
    return;
  }
  const all = [...section.read_mm, ...section.ball_mm].filter((value) => value !== null);
  const low = Math.min(0, ...all), high = Math.max(...all), room = 0.08 * (high - low || 1);
  const [x0, x1] = [section.x_mm[0], section.x_mm[section.x_mm.length - 1]];
  const atX = (x) => left + (width - left - right) * (x - x0) / (x1 - x0);
  const atY = (z) => top + (height - top - bottom) * (z - low + room) / (high - low + 2 * room);
  const grid = (from, to, place, horizontal) => {
    const unit = step(to - from), digits = Math.max(0, -Math.floor(Math.log10(unit)));
    for (let at = Math.ceil(from / unit) * unit; at <= to + 1e-9; at += unit) {
      const pixel = Math.round(place(at)) + 0.5;
      pen.strokeStyle = "#e6e9ef";
      pen.beginPath();
      pen.moveTo(horizontal ? left : pixel, horizontal ? pixel : top);
      pen.lineTo(horizontal ? width - right : pixel, horizontal ? pixel : height - bottom);
      pen.stroke();
      pen.textAlign = horizontal ? "right" : "center";
      const said = (Math.abs(at) < 1e-9 ? 0 : at).toFixed(digits).replace("-", "−");
      pen.fillText(said, horizontal ? left - 5 : pixel, horizontal ? pixel + 4 : height - bottom + 14);
    }
  };
  pen.lineWidth = 1;
  grid(low, high, atY, true);
  grid(x0, x1, atX, false);
  pen.textAlign = "center";
  pen.fillText("along x (mm)", (left + width - right) / 2, height - 4);
  pen.save();
  pen.translate(11, (top + height - bottom) / 2);
  pen.rotate(-Math.PI / 2);
  pen.fillText("depth (mm)", 0, 0);
  pen.restore();
  const line = (values, colour, wide) => {
    pen.strokeStyle = colour;
    pen.lineWidth = wide;
    pen.beginPath();
    let drawn = false;
    values.forEach((value, index) => {
      if (value === null) { drawn = false; return; }
      const to = [atX(section.x_mm[index]), atY(value)];
      if (drawn) pen.lineTo(...to); else pen.moveTo(...to);
      drawn = true;
    });
    pen.stroke();
  };
  line(section.ball_mm, "#d9730d", 4);
  line(section.read_mm, "#1f5fbf", 1.8);
}
