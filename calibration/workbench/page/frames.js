"use strict";
// Frames of a press: the picture, its height map and a section through it; each is fetched when it is looked at.

async function showFrames(press) {
  const place = document.getElementById("frames");
  if (!press) return;
  let found;
  try { found = await (await fetch(`frames?recording=${press.recording}&press=${encodeURIComponent(press.name.split("/").at(-1))}`)).json(); } catch { return; }
  if (!found.frames || !found.frames.length) { place.replaceChildren(); return; }
  if (place.dataset.press === press.name) return;
  place.dataset.press = press.name;
}
