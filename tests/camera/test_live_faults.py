"""`live` names what happens to the light while it runs, and does not follow it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from test_live_command import frames, run

from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.write import write_image

from lamp_sensor import saved  # isort: skip  # found by test_live_command


def test_what_happens_to_the_picture_is_named_once_and_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = frames()[:6]
    for number, rgb in enumerate([*sound, *(rgb[:, ::-1] for rgb in sound[:3])]):
        write_image(tmp_path / "in" / f"{number:02d}.png", rgb)
    followed: list[Any] = []
    monkeypatch.setattr(Reconstructor, "follow", lambda self, rgb, share: followed.append(rgb))
    words = ("--camera", tmp_path / "in", "--sensor", saved(tmp_path), "--every")
    assert run("live", *words, "--json", tmp_path / "told.json") == 0
    said = " ".join(capsys.readouterr().err.split())
    assert said.count("06.png: the frames are mirrored left to right") == said.count("mirrored") == 1
    assert "3 of 9 frames are flagged 'light': most of the picture differs from the reference" in said
    assert json.loads((tmp_path / "told.json").read_text())["flags"]["light"] == 3
    assert len(followed) == 6
