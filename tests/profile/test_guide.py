"""The guide: circles drawn, kept and fitted; who may ask its page and who may not; a real browser draws."""

from __future__ import annotations

import http.client
import json
import re
import shutil
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sample_light import light_of_sample

from tactilevision.cli import main
from tactilevision.errors import InputError
from tactilevision.profile.ball_guide import Guide, Session, labels_of, start_table
from tactilevision.profile.storage import read_profile
from tactilevision.recording import layout
from tactilevision.recording.read import read_recording
from tactilevision.recording.tables import read_table

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
NASTY = '<img src=x onerror="document.title=1">.png'


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """The sample's light and its first balls, the first under a name that a page must not take for HTML."""
    folder = light_of_sample(tmp_path, balls=5)
    table, pictures = folder / "reference" / "ball.csv", folder / "reference" / "ball"
    name = table.read_text().splitlines()[1].partition(",")[0]
    (pictures / name).rename(pictures / NASTY)
    table.write_text(table.read_text().replace(name, '"' + NASTY.replace('"', '""') + '"'))
    return folder


@pytest.fixture
def page(recording: Path) -> Iterator[Guide]:
    with Guide(Session(read_recording(recording))) as guide:
        yield guide


def ask(page: Guide, method: str, path: str, **headers: str) -> tuple[int, bytes, Any]:
    """One request; the token goes before `path` unless that begins with a slash."""
    body = headers.pop("body", None)
    whole = path if path.startswith("/") else f"/{page.token}/{path}"
    with closing(http.client.HTTPConnection("127.0.0.1", page.port, timeout=30)) as line:
        line.request(method, whole, body, {name.replace("_", "-"): value for name, value in headers.items()})
        answer = line.getresponse()
        return answer.status, answer.read(), answer.headers


def post(page: Guide, path: str, content: object) -> tuple[int, dict[str, Any]]:
    own = f"http://127.0.0.1:{page.port}"
    status, body, _ = ask(
        page, "POST", path, Origin=own, Content_Type="application/json", body=json.dumps(content)
    )
    return status, json.loads(body) if body.startswith(b"{") else {}


def test_a_label_is_kept_and_what_is_left_out_returns(recording: Path) -> None:
    table = recording / layout.BALL_TABLE
    text = table.read_text().splitlines()
    table.write_text("\n".join([text[0] + ",who", *(row + ",me" for row in text[1:])]) + "\n")
    session = Session(read_recording(recording))
    assert [label.state for label in session.labels] == ["found"] * 5
    session.set(1, {"circle": [100.5, 90.25, 20.0], "state": "checked"})
    session.set(2, {"circle": None, "state": "excluded"})
    session.save()
    kept = read_table(table, layout.BALL_COLUMNS)
    assert len(kept.lines) == 4
    assert kept.words["frame"][0] == NASTY
    np.testing.assert_allclose(kept.numbers["centre_x_px"], [np.nan, 100.5, np.nan, np.nan])
    assert kept.extra["who"].tolist() == ["me"] * 4
    again = labels_of(read_recording(recording))
    assert [label.state for label in again] == ["not found", "checked", "not found", "not found", "excluded"]
    assert again[1].circle == (100.5, 90.25, 20.0)


def test_a_recording_without_a_table_gets_one(recording: Path) -> None:
    (recording / layout.BALL_TABLE).unlink()
    start_table(recording, None)
    assert not (recording / layout.BALL_TABLE).exists()
    start_table(recording, 2.5)
    assert [ball.ball_radius_mm for ball in read_recording(recording).balls] == [2.5] * 5


def test_a_recording_without_presses_is_refused(recording: Path) -> None:
    for path in (recording / layout.BALLS).iterdir():
        path.unlink()
    (recording / layout.BALL_TABLE).unlink()
    with pytest.raises(InputError, match="no ball presses"):
        Session(read_recording(recording))


def test_circles_that_are_none_are_refused(page: Guide) -> None:
    for circle in ([1, 2], [1, 2, 0], [1, 2, 1e6], ["1", 2, 3], [True, 2, 3], {"x": 1}, [1, 2, None], None):
        status, said = post(page, "set/0", {"circle": circle, "state": "drawn"})
        assert (status, "error" in said) == (409, True), circle
    for path in ("set/5", "set/-1", "set/x", "set/", "find/99999999999"):
        assert post(page, path, {"circle": [1, 2, 3], "state": "drawn"})[0] == 409
    assert post(page, "set/0", {"circle": [1, 2, 3], "state": "admin"})[0] == 409
    assert post(page, "else/0", {})[0] == 404
    assert [label.state for label in page.session.labels] == ["found"] * 5


def test_only_who_knows_the_address_may_ask_and_from_this_page_alone(page: Guide) -> None:
    own, kind = f"http://127.0.0.1:{page.port}", "application/json"
    assert ask(page, "GET", "presses", Origin=own)[0] == 200
    for path in ("/", "/presses", "//presses", f"/{page.token[:-1]}/presses", "/favicon.ico"):
        assert ask(page, "GET", path)[0] == 404, path
    for host in ("evil.example", f"evil.example:{page.port}", "127.0.0.1"):
        assert ask(page, "GET", "presses", Host=host)[0] == 403, host
    for origin in ("", "http://127.0.0.1", own.replace("http:", "https:")):
        assert ask(page, "GET", "presses", Origin=origin)[0] == 403, origin
    assert ask(page, "POST", "done", Content_Type=kind, body="{}")[0] == 403  # no Origin
    assert ask(page, "POST", "done", Origin=own, Content_Type=kind, body="[1]")[0] == 409
    assert ask(page, "POST", "/x/done", Origin=own, Content_Type=kind, body="{}")[0] == 404
    assert not page.done.is_set()


def test_the_page_forbids_itself_the_rest_of_the_world(page: Guide) -> None:
    _, html, headers = ask(page, "GET", "")
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "unsafe" not in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "Access-Control-Allow-Origin" not in headers
    for name in ("", "page.js", "plot.js", "page.css", "icon.svg"):
        text = ask(page, "GET", name)[1].decode().replace("http://www.w3.org/2000/svg", "")
        assert "http:" not in text, name
        assert "https:" not in text, name
        assert not re.search(r"innerHTML|insertAdjacent|document\.write|\beval\b", text), name
    assert NASTY.encode() not in html
    for path in ("../server.py", "page/../session.py", "picture/0/../1", "depth/0"):
        assert ask(page, "GET", path)[0] in (404, 409), path


def test_a_fit_tells_each_press_by_a_law_that_never_saw_it(page: Guide) -> None:
    session = page.session
    _, found = post(page, "fit", {})
    assert found["balls"] == 5
    assert found["direction_deg"] < 25.0
    assert set(found["presses"]) == {label.frame for label in session.labels}
    section = json.loads(ask(page, "GET", "section/0")[1])
    ball = np.array([np.nan if v is None else v for v in section["ball_mm"]])
    read = np.array(section["read_mm"], float)
    assert np.nanmax(np.abs(ball - read)) < 0.5 * np.nanmax(ball)
    assert abs(read).max() > 0.05  # mm
    for view in ("picture/0", "change/0", "depth/0"):
        assert ask(page, "GET", view)[1].startswith(b"\x89PNG")
    for index in range(3):
        post(page, f"set/{index}", {"circle": None, "state": "excluded"})
    _, few = post(page, "fit", {})
    assert "too few ball presses" in few["fault"]
    assert ask(page, "GET", "depth/4")[0] == 404


def test_a_label_where_nothing_was_found_becomes_one(page: Guide) -> None:
    session = page.session
    true = session.labels[0].circle
    assert true is not None
    session.labels[0] = type(session.labels[0])(NASTY, session.labels[0].path, session.labels[0].radius_mm)
    rough = [true[0] + 3.0, true[1] - 2.0, 1.1 * true[2]]
    assert post(page, "set/0", {"circle": rough, "state": "drawn"})[1]["state"] == "drawn"
    _, found = post(page, "find/0", {"circle": rough})
    assert found["state"] == "found"
    np.testing.assert_allclose(found["circle"], true, atol=1.0)


@pytest.mark.slow
def test_train_takes_the_circles_as_drawn_and_writes_a_profile(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command waits for the page, which a person here ends at once, one press left out."""
    page = []

    def draw(self: Guide) -> None:
        page.append(self.address)
        assert post(self, "set/4", {"circle": None, "state": "excluded"})[0] == 200
        assert post(self, "done", {})[0] == 200
        assert self.done.is_set()

    monkeypatch.setattr(Guide, "wait", draw)
    monkeypatch.setattr(
        "sys.argv", ["tactilevision", "train", str(recording), "--guide", "--out", str(tmp_path / "m.npz")]
    )
    assert main() == 0
    assert page[0] in capsys.readouterr().out
    assert len(read_table(recording / layout.BALL_TABLE, layout.BALL_COLUMNS).lines) == 4
    assert json.loads((tmp_path / "m.json").read_text())["balls"] == 4
    assert read_profile(tmp_path / "m.tvs").method.card.balls == 4


class Canvas:
    """The guide in a browser: circles of the session, dragged on the picture by their pixels."""

    def __init__(self, view: Any, page: Guide) -> None:
        self.view, self.page = view, page
        self.box = view.locator("#picture").bounding_box()

    def circle(self, index: int) -> tuple[float, float, float]:
        drawn = self.page.session.labels[index].circle
        assert drawn is not None
        return drawn

    def at(self, x: float, y: float) -> tuple[float, float]:
        scale = self.box["width"] / 427
        return self.box["x"] + (x + 0.5) * scale, self.box["y"] + (y + 0.5) * scale

    def drag(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        self.view.mouse.move(*self.at(*begin))
        self.view.mouse.down()
        self.view.mouse.move(*self.at(*end), steps=3)
        self.view.mouse.up()


def drag_and_check(canvas: Canvas) -> None:
    """The first circle is moved, then widened, then found by itself and checked."""
    view = canvas.view
    x, y, radius = canvas.circle(0)
    canvas.drag((x, y), (x + 4, y + 3))
    view.wait_for_selector("li:first-child [data-state='drawn']")
    np.testing.assert_allclose(canvas.circle(0), (x + 4, y + 3, radius), atol=0.6)
    canvas.drag((x + 4 + radius, y + 3), (x + 9 + radius, y + 3))
    view.wait_for_selector("body[data-fits='2']", timeout=60000)
    np.testing.assert_allclose(canvas.circle(0), (x + 4, y + 3, radius + 5), atol=0.8)
    view.keyboard.press("f")
    view.wait_for_selector("li:first-child [data-state='found']")
    view.keyboard.press("Enter")
    view.wait_for_selector("li:first-child [data-state='checked']")


def leave_out_and_take_in(canvas: Canvas) -> None:
    """The second press is left out, taken in by a click, and left out again."""
    view = canvas.view
    view.wait_for_selector("li:nth-child(2) [aria-current='true']")
    view.keyboard.press("x")
    view.wait_for_selector("li:nth-child(2) [data-state='excluded']")
    view.mouse.click(*canvas.at(60, 60))
    view.wait_for_selector("li:nth-child(2) [data-state='drawn']")
    np.testing.assert_allclose(canvas.circle(1)[:2], (60, 60), atol=0.6)
    view.keyboard.press("x")
    view.wait_for_selector("li:nth-child(2) [data-state='excluded']")


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no browser")
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_browser_draws_drags_checks_and_saves(page: Guide, recording: Path) -> None:
    sync_api = pytest.importorskip("playwright.sync_api")
    outside, faults = [], []
    with sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        view = browser.new_page(viewport={"width": 1300, "height": 900})
        view.on("request", lambda one: None if one.url.startswith(page.address) else outside.append(one.url))
        view.on("pageerror", lambda fault: faults.append(str(fault)))
        view.on("console", lambda one: faults.append(one.text) if one.type == "error" else None)
        view.goto(page.address)
        view.wait_for_selector("body[data-fits='1']", timeout=60000)
        assert view.title() == "Circles of ball presses"
        assert view.inner_text("#title") == NASTY
        assert view.inner_text("#direction").endswith("off")
        canvas = Canvas(view, page)
        drag_and_check(canvas)
        leave_out_and_take_in(canvas)
        view.click("#done")
        view.wait_for_selector(".end")
        browser.close()
    assert page.done.is_set()
    assert outside == []
    assert faults == []
    kept = read_table(recording / layout.BALL_TABLE, layout.BALL_COLUMNS)
    assert len(kept.lines) == 4
    assert np.isfinite(kept.numbers["contact_radius_px"]).sum() == 1
