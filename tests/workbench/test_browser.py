"""The page in a real browser: load, add, watch the error fall, undo, hold two states side by side, export."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hidden_sample import write_small

sync_api = pytest.importorskip("playwright.sync_api")
pytest.importorskip("plotly")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
WAIT_MS = 180_000  # ms: a fit on a busy machine
SIZES = {"laptop": (1366, 768), "phone": (390, 844)}
ODD_NAME = "p01 <img src=x onerror=alert(1)>"  # a press's label may be any text


@pytest.fixture(scope="module")
def workbench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """The command as a user starts it: its address, and the folder of its results."""
    root = tmp_path_factory.mktemp("browser")
    recording, out = write_small(root / "small"), root / "out"
    for name in ("curves.csv", "presses.csv"):
        text = (recording / name).read_text()
        (recording / name).write_text(re.sub(r"^p01,", f"{ODD_NAME},", text, flags=re.MULTILINE))
    command = [sys.executable, "-m", "tactilevision", "workbench", recording, "--no-browser", "--out", out]
    with subprocess.Popen(
        [str(part) for part in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.search(r"http://\S+", line)
        assert found, line or process.communicate()[1]
        try:
            yield found[0], out
            process.terminate()
            _, said = process.communicate(timeout=WAIT_MS / 1000)
        finally:
            process.kill()  # a server that goes on would be waited for
    assert "Traceback" not in said


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as play:
        arguments = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        opened = play.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield opened
        opened.close()


class Watched:
    """A page, and what it must not do: complain, fail, ask elsewhere."""

    def __init__(self, browser: Any, address: str, size: str = "laptop", scheme: str = "light") -> None:
        width, height = SIZES[size]
        self.page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
        self.page.set_default_timeout(WAIT_MS)
        self.faults: list[str] = []
        own = address.rsplit("/", 2)[0]
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda fault: self.faults.append(str(fault)))
        self.page.on("dialog", lambda one: self.faults.append(one.message))
        self.page.on("request", lambda one: self._elsewhere(one.url, own))
        self.page.goto(address)

    def _hear(self, said: Any) -> None:
        if said.type in ("error", "warning"):
            self.faults.append(said.text)

    def _elsewhere(self, url: str, own: str) -> None:
        if not url.startswith((f"{own}/", "data:", "blob:")):
            self.faults.append(f"a request to {url}")

    def bars(self) -> list[float]:
        """The errors on the screen."""
        return [float(text) for text in self.page.locator("#falls .bartext").all_text_contents()]


def test_the_error_falls_on_the_screen_and_rises_again(workbench: tuple[str, Path], browser: Any) -> None:
    address, out = workbench
    watched = Watched(browser, address)
    page = watched.page
    page.wait_for_selector("#falls .bartext")
    assert len(watched.bars()) == 1
    assert page.locator("#presses img").count() == 0, "a name is text, whatever it says"
    assert page.get_by_text(ODD_NAME).count() > 0
    page.click("[data-add=viscoelasticity]")
    page.wait_for_selector("[data-remove=viscoelasticity]")
    page.wait_for_function("() => document.querySelectorAll('#falls .bartext').length === 2")
    first, last = watched.bars()
    assert last < 0.7 * first
    page.wait_for_selector("#legend:has-text('viscoelasticity')")
    page.click("#label")
    page.fill("#name", "cured")
    page.keyboard.press("Enter")
    page.wait_for_selector("#states h3:text('cured')")
    page.click("#undo")
    page.wait_for_function("() => document.querySelectorAll('#falls .bartext').length === 1")
    assert watched.bars() == [first]
    page.click("#compare")
    page.wait_for_selector("#sides td:text('viscoelasticity')")
    page.wait_for_selector("#legend:has-text('cured')")
    page.click("#redo")
    page.wait_for_selector("[data-remove=viscoelasticity]")
    page.click("#export")
    page.wait_for_function("() => document.querySelector('#notice').textContent.includes('Written')")
    written = {path.name for path in out.iterdir()}
    assert {"report.html", "calibration.json", "history.json", "repeat.sh", "comparison.json"} <= written
    assert "--with viscoelasticity" in (out / "repeat.sh").read_text()
    kept = json.loads((out / "history.json").read_text())
    assert [step["key"] for step in kept["steps"]] == ["viscoelasticity"]
    assert [state["name"] for state in kept["labels"]] == ["cured"]
    assert watched.faults == []
    page.close()


@pytest.mark.parametrize(
    ("size", "scheme"),
    [
        ("phone", "light"),
        pytest.param("phone", "dark", marks=pytest.mark.slow),
        pytest.param("laptop", "light", marks=pytest.mark.slow),
        pytest.param("laptop", "dark", marks=pytest.mark.slow),
    ],
)
def test_the_page_fits_a_screen_and_is_reached_by_keyboard(
    workbench: tuple[str, Path], browser: Any, size: str, scheme: str
) -> None:
    watched = Watched(browser, workbench[0], size, scheme)
    page = watched.page
    page.wait_for_selector("#falls .bartext")
    assert page.evaluate("document.documentElement.scrollWidth") <= SIZES[size][0]
    dark = page.evaluate("getComputedStyle(document.body).backgroundColor") != "rgb(255, 255, 255)"
    assert dark == (scheme == "dark")
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate("document.activeElement.id || Object.values(document.activeElement.dataset)[0] || ''")
        )
    assert {"label", "export"} <= reached
    page.keyboard.press("j")
    unnamed = page.evaluate(
        "[...document.querySelectorAll('button, input, select')].filter(n => !n.closest('dialog')"
        " && !(n.textContent.trim() || n.ariaLabel || n.labels && n.labels.length)).length"
    )
    assert unnamed == 0
    assert watched.faults == []
    page.close()


def test_after_a_change_a_phone_shows_how_the_error_falls(workbench: tuple[str, Path], browser: Any) -> None:
    watched = Watched(browser, workbench[0], "phone")
    page = watched.page
    page.wait_for_selector("#falls .bartext")
    before = len(watched.bars())
    button = "[data-remove=viscoelasticity]" if before == 2 else "[data-add=viscoelasticity]"
    page.locator(button).first.click()
    page.wait_for_function(f"() => document.querySelectorAll('#falls .bartext').length === {3 - before}")
    page.wait_for_function(
        "() => { const top = document.getElementById('falls').getBoundingClientRect().top;"
        " return top >= 0 && top < innerHeight / 2; }"
    )
    page.click("#undo")
    page.wait_for_function(f"() => document.querySelectorAll('#falls .bartext').length === {before}")
    assert watched.faults == []
    page.close()


OWN = """
from calibration.model.stages import EffectBase, Stage, amplitude


class Own(EffectBase):
    key = "own_gain"
    stage = Stage.INSTRUMENT
    parameters = (amplitude("late", "1", 0.2, "change from first press to last", 0.01),)

    def apply(self, state, values, data):
        return state.times(force_N=1 + values[0] * (data.presses.order / data.presses.order.max())[data.press])
"""


def test_keys_and_an_effect_of_ones_own(workbench: tuple[str, Path], browser: Any) -> None:
    watched = Watched(browser, workbench[0])
    page = watched.page
    page.wait_for_selector("[data-own=card]")
    page.keyboard.press("?")
    assert page.locator("#keys").is_visible()
    page.keyboard.press("Escape")
    before = len(watched.bars())
    page.click("[data-own=card]")
    assert "class MyEffect" in page.input_value("#own-text")
    page.fill("#own-text", OWN.replace("def", "de"))
    page.click("#own-run")
    page.wait_for_selector("#own-fault:has-text('SyntaxError')")
    page.fill("#own-text", OWN)
    page.click("#own-run")
    page.wait_for_function(f"() => document.querySelectorAll('#falls .bartext').length === {before + 1}")
    page.wait_for_selector("#own", state="hidden")
    page.keyboard.press("Control+z")
    page.wait_for_function(f"() => document.querySelectorAll('#falls .bartext').length === {before}")
    page.keyboard.press("Tab")
    assert watched.faults == []
    page.close()


def test_axe_finds_no_lack_of_contrast_and_no_missing_label(workbench: tuple[str, Path], browser: Any) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-core is not installed")
    watched = Watched(browser, workbench[0], "laptop", "light")
    for scheme in ("light", "dark"):
        watched.page.emulate_media(color_scheme=scheme)
        watched.page.wait_for_selector("#press-chart .main-svg", state="attached")
        found = axe.Axe().run(watched.page).response["violations"]
        assert [(one["id"], [node["target"] for node in one["nodes"]]) for one in found] == [], scheme
    watched.page.close()
