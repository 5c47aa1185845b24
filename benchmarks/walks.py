"""Seconds of processor time until the page names the cause, and until the error has fallen, on five samples.

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


def walk(name: str, browser: Any, screenshots: Path | None, *, whole: bool) -> None:
    """Open one sample, wait for the verdict, add what it names or an own effect, and print the seconds."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "tactilevision", "workbench", SAMPLES / name, "--no-browser", "--out"]
        with subprocess.Popen(
            [*map(str, command), f"{folder}/out"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            start_new_session=True,
        ) as server:  # fmt: skip
            assert server.stdout is not None
            found = re.search(r"http://\S+", server.stdout.readline())
            assert found is not None
            try:
                told = seconds(found[0], browser, server.pid, name, screenshots, whole)
            finally:
                os.killpg(server.pid, 9)
    print(f"{name:16} {told}", flush=True)


def seconds(address: str, browser: Any, group: int, name: str, screenshots: Path | None, whole: bool) -> str:
    """The walk on the page, in words."""
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.set_default_timeout(PATIENCE_MS)
    faults: list[str] = []
    page.on("console", lambda said: faults.append(said.text) if said.type in ("error", "warning") else None)
    page.on("pageerror", lambda fault: faults.append(str(fault)))
    page.goto(address)
    page.wait_for_selector("#presses .press")
    painted = processor_s(group)
    if not whole:
        page.close()
        return f"{painted:6.1f}"
    page.wait_for_function(
        "() => /ADEQUATE|IDENTIFIED|AMBIGUOUS|UNKNOWN/.test(document.querySelector('#verdict').innerText)"
    )
    page.wait_for_function("() => !document.querySelector('#busy').classList.contains('on')")
    verdict, named = page.inner_text("#verdict").split("\n")[0], processor_s(group)
    keep(page, screenshots, f"{name}_verdict")
    before = page.locator("#falls .bartext").all_text_contents()
    if page.locator("[data-own='']").count():  # UNKNOWN: the editor begins with the shape that was found
        page.locator("[data-own='']").first.click()
        page.click("#own-run")
    elif page.locator("[data-cure]").count():
        page.locator("[data-cure=all], [data-cure]").first.click()
    if verdict.split(".")[0] != "ADEQUATE":
        page.wait_for_function(f"() => document.querySelectorAll('#falls .bartext').length > {len(before)}")
    fell = processor_s(group)
    after = page.locator("#falls .bartext").all_text_contents()
    keep(page, screenshots, f"{name}_fallen")
    page.close()
    told = f"{painted:6.1f} {named:8.1f} {fell:8.1f}   {verdict[:60]}: {' '.join(before)} -> {' '.join(after)}"
    return told + (f"\n    console: {faults}" if faults else "")


def keep(page: Any, screenshots: Path | None, name: str) -> None:
    """Keep the page as it looks at three widths, in light and dark."""
    for width, height in SIZES if screenshots is not None else ():
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
            walk(name, browser, screenshots, whole=whole)


def quick() -> None:
    """Open one sample, to the first presses on the page."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        print("there is no Chromium here")
        return
    walks(("hidden_two",), chromium, None, whole=False)


if __name__ == "__main__":
    main(sys.argv[1:])
