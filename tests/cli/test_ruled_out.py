"""What the frames themselves rule out is not named by a diagnosis."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tactilevision.heightmap import shadows_seen
from tactilevision.heightmap.shadows_seen import SAID, shows_none
from tactilevision.pipeline import not_in_frames


def found(*keys: str, candidates: tuple[str, ...] = ()) -> Any:
    return SimpleNamespace(effects=[SimpleNamespace(key=key) for key in keys], candidates=candidates)


@pytest.mark.parametrize(
    ("shown", "named", "ruled_out"),
    [
        ((True, True), found("cast_shadow"), ("cast_shadow",)),
        ((True, True), found(candidates=("cast_shadow", "slope_saturation")), ("cast_shadow",)),
        ((True, False), found("cast_shadow"), ()),
        ((True, True), found("slope_saturation"), ()),
    ],
)
def test_an_effect_is_ruled_out_where_no_recording_shows_its_cause(
    shown: tuple[bool, ...], named: Any, ruled_out: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shadows_seen, "shows_none", lambda recording, reader: recording)
    taken: list[Any] = [SimpleNamespace(recording=one, reconstructor=object()) for one in shown]
    assert not_in_frames(taken, named) == ruled_out


def test_without_maps_nothing_is_ruled_out() -> None:
    points: Any = SimpleNamespace(recording=None, reconstructor=None)
    assert not_in_frames([points], found("cast_shadow")) == ()


@pytest.mark.parametrize(
    ("share", "none"), [(0.04, True), (-0.02, True), (0.31, False), (None, False), (float("nan"), False)]
)
def test_shadows_are_ruled_out_only_where_frames_can_tell(
    share: float | None, none: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader: Any = SimpleNamespace(shadows=object(), lean=1.0, warnings=(SAID, "else"))
    recording: Any = None
    monkeypatch.setattr(shadows_seen, "share_seen", lambda recording, reader: share)
    assert shows_none(recording, reader) is none
    assert (reader.shadows, reader.warnings) == (None, ("else",))
