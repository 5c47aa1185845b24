"""Seconds of processor time until the page names the cause, and until the error has fallen, on five samples.

Each sample is walked through twice: on a wide light screen by the verdict's own button, and on a narrow dark one
by the cards, with undo and redo. The cache is empty at the start. The time is that of the command and its
processes, without the browser's.

python -m benchmarks.walks [--screenshots FOLDER]
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SAMPLES = Path(__file__).parents[1] / "sample_frames"
WALKS = ("hidden_material", "hidden_rig", "hidden_unknown", "hidden_two", "hidden_shadow")
PATIENCE_MS = 1_800_000
TICKS = os.sysconf("SC_CLK_TCK")
SIZES = ((1440, 900), (1024, 768), (390, 844))  # px of the screenshots
WIDE, NARROW = (SIZES[0], "light"), (SIZES[2], "dark")  # screens of the two walks
NAMED = "() => /ADEQUATE|IDENTIFIED|AMBIGUOUS|UNKNOWN/.test(document.querySelector('#verdict').innerText)"
BARS = "#falls .bartext"  # the error of each model


def processor_s(group: int) -> float:
    """Processor time of all processes of a group, with that of children that have ended."""
    total = 0
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended since
        if int(fields[2]) == group:
            total += sum(int(one) for one in fields[11:15])
    return total / TICKS


def walk(name: str, browser: Any, screenshots: Path | None, *, narrow: bool, whole: bool) -> None:
    """Open one sample, wait for the verdict, add what it names or an own effect, and print the seconds."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "tactilevision", "workbench", SAMPLES / name, "--no-browser", "--out"]
        with subprocess.Popen(
            [*map(str, command), f"{folder}/out"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            start_new_session=True, env=os.environ | {"TACTILEVISION_CACHE": f"{folder}/cache"},
        ) as server:  # fmt: skip
            assert server.stdout is not None
            found = re.search(r"http://\S+", server.stdout.readline())
            assert found is not None
            (width, height), scheme = NARROW if narrow else WIDE
            page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
            try:
                told = seconds(page, found[0], server.pid, name, None if narrow else screenshots, whole)
                if narrow and screenshots is not None:
                    page.screenshot(path=str(screenshots / f"{name}_{width}_{scheme}_cards.png"), full_page=True)
            finally:
                os.killpg(server.pid, 9)
                page.close()
    print(f"{name:16} {'cards' if narrow else 'button':7}{told}", flush=True)


def seconds(page: Any, address: str, group: int, name: str, screenshots: Path | None, whole: bool) -> str:
    """Return the walk on the page in words: by the verdict's button on a wide page, by cards on a narrow one."""
    faults: list[str] = []
    page.set_default_timeout(PATIENCE_MS)
    page.on("console", lambda said: faults.append(said.text) if said.type in ("error", "warning") else None)
    page.on("pageerror", lambda fault: faults.append(str(fault)))
    page.goto(address)
    page.wait_for_selector("#presses .press")
    painted = processor_s(group)
    if not whole:
        return f"{painted:6.1f}"
    page.wait_for_function(NAMED)
    page.wait_for_function("() => !document.querySelector('#busy').classList.contains('on')")
    verdict, named = page.inner_text("#verdict").split("\n")[0], processor_s(group)
    keep(page, screenshots, f"{name}_verdict")
    before = page.locator(BARS).all_text_contents()
    by_cards = page.viewport_size["width"] == NARROW[0][0]
    if verdict.split(".")[0] != "ADEQUATE":
        (add_by_cards if by_cards else add_by_button)(page)
    fell = processor_s(group)
    after = page.locator(BARS).all_text_contents()
    if by_cards and len(after) > len(before):
        undone_and_redone(page, before, after)
    turn_section(page)
    keep(page, screenshots, f"{name}_fallen")
    told = f"{painted:6.1f} {named:8.1f} {fell:8.1f}   {verdict[:60]}: {' '.join(before)} -> {' '.join(after)}"
    return told + (f"\n    console: {faults}" if faults else "")


def add_by_button(page: Any) -> None:
    """Add what the verdict names by its button, or an own effect of the shape that an UNKNOWN leaves."""
    count = page.locator(BARS).count()
    if page.locator("[data-own='']").count():  # the editor begins with the shape that was found
        page.locator("[data-own='']").first.click()
        page.click("#own-run")
    else:
        page.locator("[data-cure=all], [data-cure]").first.click()
    page.wait_for_function(f"() => document.querySelectorAll('{BARS}').length > {count}")


def add_by_cards(page: Any) -> None:
    """Add what the verdict names by the buttons of its cards, one after the other; an own effect by its link."""
    keys = [one.get_attribute("data-cure") for one in page.locator("[data-cure]").all()]
    for key in [key for key in keys if key != "all"] if not page.locator("[data-own='']").count() else [""]:
        count = page.locator(BARS).count()
        page.locator(f"[data-add={key}]" if key else "[data-own=card]").first.click()
        if not key:
            page.click("#own-run")
        page.wait_for_function(f"() => document.querySelectorAll('{BARS}').length > {count}")


def undone_and_redone(page: Any, before: Sequence[str], after: Sequence[str]) -> None:
    """Take the effects back and add them again by the keyboard; the bars must follow."""
    page.evaluate("document.activeElement.blur()")
    for key, count in (("u", -1), ("r", 1)):
        for step in range(1, len(after) - len(before) + 1):
            wanted = len(after) - step if count < 0 else len(before) + step
            page.keyboard.press(key)
            page.wait_for_function(f"() => document.querySelectorAll('{BARS}').length == {wanted}")
    assert page.locator(BARS).all_text_contents() == list(after)


def turn_section(page: Any) -> None:
    """Draw a section at an angle through the height map, where there is one."""
    box = page.locator("#frame-height").bounding_box() if page.locator("#frame-height").count() else None
    if box is None:
        return
    page.locator("#frame-height").scroll_into_view_if_needed()
    box = page.locator("#frame-height").bounding_box()
    for act, share in ((page.mouse.move, 0.3), (page.mouse.down, 0), (page.mouse.move, 0.7), (page.mouse.up, 0)):
        act(*((box["x"] + share * box["width"], box["y"] + share * box["height"]) if share else ()))
    assert "at 0°" not in page.inner_text("#map-words"), "the section is level"


def keep(page: Any, screenshots: Path | None, name: str) -> None:
    """Keep the page as it looks at three widths, in light and dark."""
    if screenshots is None:
        return
    for width, height in SIZES:
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(300)
            page.screenshot(path=str(screenshots / f"{name}_{width}_{scheme}.png"), full_page=True)
    page.set_viewport_size({"width": 1440, "height": 900})


def main(arguments: Sequence[str] = ()) -> None:
    """Walk through the samples."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("walks", nargs="*", default=WALKS)
    parser.add_argument("--screenshots", type=Path)
    options = parser.parse_args(arguments)
    if options.screenshots is not None:
        options.screenshots.mkdir(parents=True, exist_ok=True)
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    walks(options.walks, chromium, options.screenshots)


def walks(names: Sequence[str], chromium: str | None, screenshots: Path | None, *, whole: bool = True) -> None:
    """Print the seconds of each walk, or where it is not `whole` of the first paint alone."""
    from playwright.sync_api import sync_playwright

    print("processor time (s): presses on the page, verdict, error fallen (mN or um)")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for name in names:
            for narrow in (False, True) if whole else (False,):
                walk(name, browser, screenshots, narrow=narrow, whole=whole)


def quick() -> None:
    """Open one sample, to the first presses on the page."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        print("there is no Chromium here")
        return
    walks(("hidden_two",), chromium, None, whole=False)


if __name__ == "__main__":
    main(sys.argv[1:])
