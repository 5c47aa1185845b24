"""What takes seconds is made once, kept within bounds, and made anew where its file is damaged."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.files import cache
from tactilevision.records.measured import Curve, Estimate


def test_a_table_is_kept_read_again_and_made_anew_where_it_is_torn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEVISION_CACHE", str(tmp_path))
    calls = []

    def make() -> np.ndarray:
        calls.append(1)
        return np.arange(3.0)

    for _ in range(2):
        assert cache.kept_array("thing", ("key", 1), make=make).tolist() == [0, 1, 2]
    assert len(calls) == 1
    (path,) = tmp_path.glob("*.zip")
    path.write_bytes(path.read_bytes()[:40])
    assert cache.kept_array("thing", ("key", 1), make=make).tolist() == [0, 1, 2]
    assert len(calls) == 2
    cache.kept_array("thing", ("key", 2), make=make)
    assert len(calls) == 3


def test_the_cache_follows_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TACTILEVISION_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.cache_folder() == tmp_path / "tactilevision"
    monkeypatch.setenv("TACTILEVISION_CACHE", str(tmp_path / "file"))
    (tmp_path / "file").write_text("in the way")
    assert cache.kept_array("thing", "key", make=lambda: np.ones(2)).tolist() == [1, 1]


def test_nothing_is_kept_where_that_is_switched_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TACTILEVISION_CACHE", cache.OFF)
    made = iter((b"1", b"2"))
    assert [cache.kept("thing", "key", make=lambda: {"a": next(made)})["a"] for _ in range(2)] == [b"1", b"2"]
    assert not list(tmp_path.iterdir())


def test_what_is_not_whole_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTILEVISION_CACHE", str(tmp_path))
    made = iter((b"1", b"2", b"3"))
    found = [
        cache.kept("thing", "key", make=lambda: {"a": next(made)}, whole=partial(bool, whole))["a"]
        for whole in (0, 1, 1)
    ]
    assert found == [b"1", b"2", b"2"]


def test_the_files_used_least_recently_make_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTILEVISION_CACHE", str(tmp_path))
    monkeypatch.setattr(cache, "MOST_MB", 2.5)
    for number in range(3):
        cache.kept("thing", number, make=lambda: {"a": bytes(1_000_000)})
        for path in tmp_path.iterdir():
            os.utime(path, (path.stat().st_atime, path.stat().st_mtime - 60))
    assert len(list(tmp_path.iterdir())) == 2
    sizes = [len(cache.kept("thing", number, make=lambda: {"a": b""})["a"]) for number in (2, 1, 0)]
    assert sizes == [1_000_000, 1_000_000, 0]


def test_a_record_is_made_once_and_read_with_all_its_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEVISION_CACHE", str(tmp_path))
    curve = Curve("p1", np.arange(3.0), np.ones(3), np.zeros((3, 3)), np.array(["load", "", "hold"]))
    nu = Estimate(None, None, (np.float64(0.4), 0.5), "1", "why")
    made: Iterator[Any] = iter([({"p1": curve}, [nu, float("nan"), True])])
    first, again = (cache.kept_record("thing", "key", make=lambda: next(made)) for _ in range(2))
    for curves, (estimate, unknown, known) in (first, again):
        assert estimate == nu
        assert np.isnan(unknown)
        assert known is True
        np.testing.assert_array_equal(curves["p1"].phase, curve.phase)
        np.testing.assert_array_equal(curves["p1"].time_s, curve.time_s)
    with pytest.raises(TypeError, match="Path"):
        cache.packed_record(tmp_path)
    with pytest.raises(InputError, match="no record"):
        cache._unpacked({"class": "subprocess:Popen", "fields": {}}, {})
    hashed = [cache.packed_record(one, whatever=True) for one in (tmp_path, tmp_path / "a")]
    assert hashed[0] != hashed[1]
