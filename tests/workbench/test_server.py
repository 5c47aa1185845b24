"""Who is let in by the workbench's server, and what it hands out."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import time
from collections.abc import Iterator
from typing import Any

import pytest
from each import each
from made_bench import presses

from calibration.tasks.session import History
from calibration.workbench.bench import Bench
from calibration.workbench.opened import Opened
from calibration.workbench.server import Server
from tactilevision.errors import InputError

pytest.importorskip("plotly")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Nothing is at work behind it."""
    out = tmp_path_factory.mktemp("server")
    bench = Bench(
        Opened((), (), presses()),
        History(("made",)),
        export=lambda *_: out,
        keep=lambda _: None,
        out=out,
        asks=False,
    )
    with Server((), ()) as made:
        made.show(bench)
        yield made


def ask(
    server: Server,
    path: str = "state",
    *,
    method: str = "GET",
    body: Any = None,
    headers: dict[str, str] | None = None,
    token: str | None = None,
) -> tuple[int, dict[str, str], bytes]:
    """A request as a browser sends it, but for what the test changes."""
    link = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    own = {"Host": server.hosts[0]}
    if method == "POST":
        own |= {"Origin": f"http://{server.hosts[0]}", "Content-Type": "application/json"}
    sent = None if body is None else json.dumps(body) if not isinstance(body, str) else body
    target = f"/{server.token if token is None else token}/{path}"
    link.request(method, target, sent, {k: v for k, v in (own | (headers or {})).items() if v})
    answer = link.getresponse()
    content = answer.read()
    link.close()
    return answer.status, dict(answer.getheaders()), content


def test_it_listens_on_this_machine_alone_and_its_page_may_ask_nobody_else(server: Server) -> None:
    assert server.address.startswith("http://127.0.0.1:")
    assert len(server.token) >= 32
    status, headers, page = ask(server, "")
    assert status == 200
    assert b"<title>tactilevision workbench" in page
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "connect-src 'self'" in policy
    assert "unsafe-eval" not in policy
    assert "script-src 'self';" in policy
    assert headers["X-Content-Type-Options"] == "nosniff"


@each(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:80"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
    ],
)
@each("path", ["", "state", "curves"])
def test_another_sites_page_is_turned_away(server: Server, headers: dict[str, str], path: str) -> None:
    status, _, content = ask(server, path, headers=headers)
    assert status == 403
    assert b"error" in content


@each("token", ["", "x" * 32, "..", "%2e%2e", "ä"])
def test_without_the_token_nothing_is_found(server: Server, token: str) -> None:
    token = token.encode("utf-8").decode("latin-1")
    assert ask(server, "state", token=token.replace("Ã¤", "%C3%A4"))[0] == 404


@each(
    "path",
    [
        "../../../etc/passwd",
        "..%2f..%2fetc/passwd",
        "/etc/passwd",
        "server.py",
        "page/page.js",
        "history.json",
        "page.js/",
    ],
)
def test_no_file_is_served_but_the_pages_own(server: Server, path: str) -> None:
    assert ask(server, path)[0] == 404


@each("headers", [{"Origin": ""}, {"Origin": "http://evil.example"}, {"Origin": "null"}, {"Host": "evil.example"}])
def test_an_action_of_another_page_is_turned_away(server: Server, headers: dict[str, str]) -> None:
    body = {"action": "add", "value": "tilt", "version": 1}
    assert ask(server, "act", method="POST", body=body, headers=headers)[0] == 403


@each(
    "body, headers, status",
    [
        ({"action": "undo", "version": 1}, {"Content-Type": "text/plain"}, 403),
        ({"action": "undo"}, {}, 400),
        ({"action": 1, "version": 1}, {}, 400),
        ({"action": "undo", "version": True}, {}, 400),
        ([1, 2], {}, 409),
        ("{", {}, 409),
        ({"action": "a" * 70000, "version": 1}, {}, 413),
    ],
)
def test_an_action_that_is_none_is_refused(
    server: Server, body: Any, headers: dict[str, str], status: int
) -> None:
    code, _, content = ask(server, "act", method="POST", body=body, headers=headers)
    assert code == status
    assert json.loads(content)["error"]


@each(
    "path",
    [
        "tried?name=x&value=0",
        "tried",
        "picture?recording=0&number=0",
        "frames?recording=9&press=p0",
        "state?since=x",
        "height?recording=-1&number=0",
    ],
)
def test_a_question_without_an_answer_is_refused_with_a_reason(server: Server, path: str) -> None:
    status, _, content = ask(server, path)
    assert status in (400, 409)
    assert json.loads(content)["error"]


def test_a_taken_port_is_said(server: Server) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(InputError, match="--port"):
            Server((), (), port=taken.getsockname()[1])


def test_a_browser_that_goes_in_the_middle_of_a_question_is_no_fault(
    server: Server, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as link:
        link.sendall(b"GET /half")
        link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # closing sends a reset
    assert ask(server)[0] == 200
    time.sleep(0.3)
    assert "Traceback" not in capfd.readouterr().err
