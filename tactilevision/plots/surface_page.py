"""One page, without a second file or a request: a height map as a surface to turn, its facts, its pictures."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

import numpy as np

from tactilevision.files import write_text
from tactilevision.plots import style
from tactilevision.plots.height import deepest_place
from tactilevision.records import HeightMap
from tactilevision.records.flags import MEANING

MAX_POINTS = 240  # along a side of the surface: finer than a screen shows, and the page stays below 1 MB
RELIEF = 0.25  # of the picture's width: the height at which the surface is drawn first
UNKNOWN_UM = -32768  # no depth comes near: 33 mm out of the gel


def write_surface_page(folder: Path | str, height: HeightMap, pictures: Sequence[Path] = ()) -> Path:
    """Write NAME.html with the surface (H, W), in mm, and PNG `pictures` that exist; returns the file."""
    path = Path(folder) / f"{Path(height.name).stem or 'height'}.html"
    write_text(path, surface_page(height, pictures))
    return path


def surface_page(height: HeightMap, pictures: Sequence[Path] = ()) -> str:
    """The whole page of a map (H, W), in mm. Its text is escaped, and its data are numbers."""
    shown = "".join(
        f'<figure><img alt="{escape(path.stem)}" src="{style.data_uri(path)}"></figure>' for path in pictures
    )
    parts = {
        "@NAME@": escape(height.name or "Height map"),
        "@DOUBTS@": "".join(f'<p class="doubt">Doubtful: {escape(MEANING[flag])}.</p>' for flag in height.flags),
        "@FACTS@": "".join(f"<dt>{name}</dt><dd>{escape(value)}</dd>" for name, value in _facts(height).items()),
        "@PICTURES@": shown,
        "@DATA@": json.dumps(_data(height)),
    }
    page = files("tactilevision.plots").joinpath("surface_page.html").read_text(encoding="utf-8")
    for mark, text in parts.items():
        page = page.replace(mark, text)
    return page


def _facts(height: HeightMap) -> dict[str, str]:
    rows, columns = height.depth_mm.shape
    wide, tall = columns * height.mm_per_px[0], rows * height.mm_per_px[1]
    facts = {
        "picture": f"{columns} × {rows} px, {wide:.4g} × {tall:.4g} mm",
        "known": f"{100 * float(height.valid.mean()):.1f} % of the picture",
    }
    if height.valid.any():
        row, column = deepest_place(height)
        x, y = column * height.mm_per_px[0], row * height.mm_per_px[1]
        depth = f"{height.depth_mm[row, column]:.3f}"
        std = "" if height.std_mm is None else f" ± {height.std_mm[row, column]:.3f}"
        facts["depth in the middle of the deepest tenth"] = f"{depth}{std} mm, at x {x:.2f}, y {y:.2f} mm"
    return facts


def _data(height: HeightMap) -> dict[str, object]:
    """The surface on a coarser grid, as whole micrometres in base64, with the scale and the colours."""
    import matplotlib as mpl

    step = max(1, -(-max(height.depth_mm.shape) // MAX_POINTS))
    depth_um = np.where(height.valid, np.clip(1e3 * height.depth_mm, -32e3, 32e3), UNKNOWN_UM)[::step, ::step]
    rows, columns = depth_um.shape
    known = 1e-3 * depth_um[depth_um > UNKNOWN_UM]
    top = max(float(known.max()), 1e-3) if known.size else 1e-3
    bottom = min(float(np.percentile(known, 0.5)), 0.0) if known.size else 0.0
    colours = np.round(255 * mpl.colormaps[style.DEPTH_MAP](np.linspace(0, 1, 64))[:, :3]).astype(int)
    return {
        "rows": rows,
        "columns": columns,
        "step_mm": [step * one for one in height.mm_per_px],
        "bottom_mm": bottom,
        "top_mm": top,
        "unknown": UNKNOWN_UM,
        "relief": RELIEF,
        "colours": colours.tolist(),
        "depth_um": base64.b64encode(np.round(depth_um).astype("<i2").tobytes()).decode(),
    }
