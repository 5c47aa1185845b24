"""Records in a notebook: short tables that run nothing, figures, tables, and a fit of arrays."""

from __future__ import annotations

import sys
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from each import each

from tactilevision import HeightMap, calibrate_recording, fit, open_workbench, read_recording
from tactilevision.errors import InputError
from tactilevision.local_page import Answer, LocalPage
from tactilevision.records.maps import Frame

PAPER = Path(__file__).parents[1] / "sample_frames" / "paper_points"
EVIL = "<script>alert(1)</script>&\"'"


def bowl() -> HeightMap:
    """A paraboloid .4 mm deep at row 10, column 20, unknown in one corner."""
    y, x = np.mgrid[:30, :40]
    depth = 0.4 - 0.001 * ((x - 20) ** 2 + (y - 10) ** 2)
    return HeightMap(depth, (x > 1) | (y > 1), (0.1, 0.2), std_mm=np.full(depth.shape, 0.01), flags=("shadow",))


def test_tables_are_short_and_run_nothing() -> None:
    recording = read_recording(PAPER)
    named = replace(recording, name=EVIL, warnings=(EVIL,) * 9)
    frame = Frame(np.zeros((48, 64, 3), np.uint8), 1.0, EVIL)
    result = calibrate_recording(recording, test=False).noted(EVIL)
    for one in (named, frame, replace(bowl(), name=EVIL), result):
        text = one._repr_html_()
        assert "<script" not in text
        assert "&lt;script&gt;" in text
        assert len(text) < 6000
        assert len(repr(one)) < 3000
    assert "5 more" in named._repr_html_()
    assert "0.400 mm, std 0.01 mm" in repr(bowl())
    assert "3.4943" in repr(result)


def test_a_map_is_drawn_with_its_unit_and_its_deviation_on_request() -> None:
    labels = [axes.get_ylabel() for axes in bowl().plot(std=True).axes]
    assert [label for label in labels if "(mm)" in label or "(µm)" in label] == [
        "y (mm)", "y (mm)", "depth into the gel (mm)", "standard deviation (µm)"
    ]  # fmt: skip
    figure = bowl().plot()
    assert len(figure.axes) == 2
    assert str(figure._repr_html_()).startswith('<img alt="figure" src="data:image/png;base64,')
    with pytest.raises(InputError, match="states no standard deviation"):
        replace(bowl(), std_mm=None).plot(std=True)


def test_a_map_becomes_a_dataset_in_mm(monkeypatch: pytest.MonkeyPatch) -> None:
    found = bowl().to_xarray()
    assert float(found.depth_mm.sel(x=0.05, y=-0.9, method="nearest")) == pytest.approx(0.4)
    assert found.x.values[[0, -1]] == pytest.approx([-1.95, 1.95])
    assert found.y.attrs["units"] == "mm"
    assert np.isnan(found.std_mm.values[0, 0])
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match=r"xarray is missing.*\[notebook\]"):
        bowl().to_xarray()


def test_arrays_give_what_the_paper_printed() -> None:
    """c = 3.4943, beta = 1.5071 of the paper's five points."""
    points = read_recording(PAPER).points
    depth, force = ([getattr(one, name) for one in points] for name in ("depth_mm", "fz_N"))
    result = fit(depth, force, radius_mm=2.5, thickness_mm=3)
    assert result.c.value == pytest.approx(3.4943, abs=2e-4)
    assert result.beta.value == pytest.approx(1.5071, abs=3e-4)
    assert result.youngs_modulus.value is None
    table = result.to_frame()
    assert table.depth_mm.tolist() == depth
    assert table.accepted.all()
    assert len(result.plot_fit().axes) == 4
    assert fit(depth, force, radius_mm=2.5, thickness_mm=3, nu=0.48).youngs_modulus.value is not None


def test_readings_of_a_press_share_its_errors() -> None:
    """A line P = 3 w (1 + .6 w/3) through presses with a gain of 2 % each and little noise."""
    rng, count = np.random.default_rng(5), 30
    press = np.repeat(["a", "b", "c", "d"], count)
    depth = np.tile(np.linspace(0.02, 0.6, count), 4)
    gain = np.repeat(1 + 0.02 * rng.standard_normal(4), count)
    force = gain * 3 * depth * (1 + 0.2 * depth) + 0.003 * rng.standard_normal(depth.size)
    time = np.arange(depth.size) * 0.1 + 10 * np.repeat(np.arange(4), count)
    how = {"radius_mm": 2.5, "thickness_mm": 3.0, "nu": 0.48}
    whole, each_alone = fit(depth, force, time_s=time, press=press, **how), fit(depth, force, **how)  # type: ignore[arg-type]
    low, high = whole.c.interval95 or (0.0, 0.0)
    assert low < 3 < high
    assert whole.c.std is not None
    assert each_alone.c.std is not None
    assert whole.c.std > each_alone.c.std
    assert whole.to_frame().press.tolist() == ["a", "b", "c", "d"]


@each(
    "given, said",
    [
        ({"depth_mm": []}, "depth_mm: an array"),
        ({"depth_mm": 0.3}, "depth_mm: an array"),
        ({"force_N": [1.0]}, "force_N: an array"),
        ({"force_N": [1.0, 2.0, np.nan]}, "force_N\\[2\\]: a number is not finite"),
        ({"radius_mm": "wide"}, "radius_mm: numbers are needed"),
        ({"radius_mm": -1}, "radius_mm must lie between"),
        ({"radius_mm": [1, 2]}, "radius_mm: an array \\(N,\\) is needed, or one number"),
        ({"thickness_mm": [3, 3, 4]}, "thickness_mm: all samples need the same number"),
        ({"nu": 0.6}, "poisson_ratio must lie between"),
        ({"press": "abc"}, "need their times"),
        ({"press": "ab", "time_s": [0, 1, 2]}, "one label a sample"),
        ({"depth_mm": [-0.1, -0.2, -0.3]}, "above 0 mm"),
    ],
)
def test_bad_arrays_are_one_clear_error(given: dict[str, object], said: str) -> None:
    good: dict[str, object] = {"depth_mm": [0.1, 0.2, 0.3], "force_N": [0.3, 0.7, 1.1]}
    with pytest.raises(InputError, match=said):
        fit(**{**good, "radius_mm": 2.5, "thickness_mm": 3, **given})  # type: ignore[arg-type]


def test_only_a_page_that_may_be_framed_opens_in_a_frame() -> None:
    frame = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "iframe", "Sec-Fetch-Mode": "navigate"}
    script = frame | {"Sec-Fetch-Dest": "empty", "Sec-Fetch-Mode": "cors"}
    answer = {"": Answer("text/html", b"here")}
    with LocalPage(answer, framed=True) as page:
        got = urllib.request.urlopen(urllib.request.Request(page.address, headers=frame), timeout=5)  # noqa: S310
        assert "frame-ancestors http://127.0.0.1:* http://localhost:*" in got.headers["Content-Security-Policy"]
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(urllib.request.Request(page.address, headers=script), timeout=5)  # noqa: S310
    with LocalPage(answer) as page, pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(urllib.request.Request(page.address, headers=frame), timeout=5)  # noqa: S310


@pytest.mark.slow
def test_a_workbench_opens_in_a_frame_and_ends(tmp_path: Path) -> None:
    bench = open_workbench(PAPER, out=tmp_path)
    assert f'<iframe src="{bench.address}"' in bench._repr_html_()
    assert urllib.request.urlopen(bench.address, timeout=5).status == 200  # noqa: S310
    bench.close()
    bench.close()
    with pytest.raises(InputError, match="no such folder"):
        open_workbench(tmp_path / "nowhere")
