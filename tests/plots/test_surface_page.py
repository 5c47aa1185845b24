"""The page with a surface to turn: it needs no other file, escapes what it shows, and turns in a browser."""

from __future__ import annotations

import base64
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from tactilevision.plots.viewer import UNKNOWN_UM, surface_page, write_surface_page
from tactilevision.records.maps import LIGHT, MEANING, HeightMap

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
HOSTILE = "</script><img src=x onerror=alert(1)>.png"


def dent(name: str = "dent.png") -> HeightMap:
    y, x = np.mgrid[:300, :400]
    depth = 0.4 * np.exp(-((x - 200) ** 2 + (y - 150) ** 2) / 2000)
    return HeightMap(depth, x > 20, (0.05, 0.05), name=name, flags=(LIGHT,))


def test_the_page_holds_the_surface_and_needs_nothing_else() -> None:
    page = surface_page(dent())
    data = json.loads(re.search(r'id="data">(.*?)</script>', page)[1])  # type: ignore[index]
    depth_um = np.frombuffer(base64.b64decode(data["depth_um"]), "<i2").reshape(data["rows"], data["columns"])
    assert data["step_mm"] == [0.1, 0.1]
    assert depth_um[75, 100] == 400
    assert (depth_um[:, :10] == UNKNOWN_UM).all()
    assert not re.search(r"""(src|href)=["'](?!data:)|https?://|url\(""", page)
    assert MEANING[LIGHT] in page
    assert "@" not in re.sub(r"@media|base64,[^\"]*", "", page)


def test_a_hostile_name_stays_text() -> None:
    assert HOSTILE not in surface_page(dent(HOSTILE))
    assert "&lt;/script&gt;&lt;img" in surface_page(dent(HOSTILE))


def test_a_map_of_which_nothing_is_known_has_a_page() -> None:
    nothing = HeightMap(np.zeros((5, 6)), np.zeros((5, 6), np.bool_), (0.1, 0.1), name="n")
    assert "0.0 % of the picture" in surface_page(nothing)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no browser is installed")
def test_the_surface_turns_in_a_browser(tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    path = write_surface_page(tmp_path, dent())
    faults: list[str] = []
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--use-gl=swiftshader", "--enable-unsafe-swiftshader"]
        )
        page = browser.new_page(viewport={"width": 900, "height": 800})
        page.on("pageerror", lambda fault: faults.append(str(fault)))
        page.goto(path.as_uri())
        assert page.evaluate("corners.length") > 100_000
        canvas = page.locator("#surface")
        flat, seen = page.locator("#times").inner_text(), canvas.screenshot()
        canvas.focus()
        for _ in range(4):
            page.keyboard.press("ArrowLeft")
        page.wait_for_timeout(200)
        turned = canvas.screenshot()
        assert page.evaluate("view.turn") == pytest.approx(-0.9)
        page.locator("#relief").fill("0.9")
        page.wait_for_timeout(200)
        assert page.locator("#times").inner_text() != flat
        page.locator("#home").click()
        page.wait_for_timeout(200)
        assert canvas.screenshot() == seen != turned
        browser.close()
    assert faults == []
