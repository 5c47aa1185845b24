"""Pictures inside a page: a drawing keeps every bit, and a photograph is made small."""

from __future__ import annotations

import base64
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from tactilevision.plots.style import data_uri, holds_photographs, save_figure
from tactilevision.records.measured import Bytes


def decoded(uri: str) -> Bytes:
    head, _, content = uri.partition(",")
    assert head == "data:image/webp;base64"
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return np.asarray(picture)


def test_a_drawing_keeps_every_bit_and_takes_less_room(tmp_path: Path) -> None:
    figure = Figure(figsize=(4, 3))
    axes = figure.subplots()
    axes.plot(np.sin(np.linspace(0, 9, 200)), "o-", label="drawn")
    axes.legend()
    save_figure(figure, tmp_path / "drawn.png")
    uri = data_uri(tmp_path / "drawn.png", photograph=holds_photographs(figure))
    assert np.array_equal(decoded(uri), np.asarray(cv2.imread(str(tmp_path / "drawn.png"))))
    assert len(uri) < 0.8 * 4 / 3 * (tmp_path / "drawn.png").stat().st_size


def test_a_photograph_becomes_small_and_keeps_its_look(tmp_path: Path) -> None:
    y, x = np.mgrid[:300, :400]
    smooth = 127 + 90 * np.sin(x / 60) * np.cos(y / 50)
    seen = smooth[..., None] + np.random.default_rng(0).normal(0, 2, (300, 400, 3))
    cv2.imwrite(str(tmp_path / "seen.png"), np.clip(seen, 0, 255).astype(np.uint8))
    uri = data_uri(tmp_path / "seen.png", photograph=True)
    assert len(uri) < 0.3 * (tmp_path / "seen.png").stat().st_size
    assert np.sqrt(np.mean((decoded(uri) - seen) ** 2)) < 4
