"""Who is let in by the pages of this machine, and what a request that is none may cost."""

from __future__ import annotations

import ast
import base64
import json
import os
import re
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each

from tactilevision import local_page
from tactilevision.local_page import Answer, LocalPage
from tactilevision.profile.sensor import load_sensor
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes
from tactilevision.robots.camera import Shot
from tactilevision.robots.live import LiveResult, Stream
from tactilevision.robots.preview import Foxglove, Preview, Streamed

sys.path.insert(0, str(Path(__file__).parents[1] / "profile"))
from lamp_sensor import free, pressed, saved

ROOT = Path(__file__).parents[2]


class Plain(LocalPage):
    """One page, and one action that returns what it was given."""

    def post(self, name: str, content: dict[str, Any]) -> dict[str, Any] | None:
        if name == "fail":
            raise RuntimeError("its own fault")
        return content if name == "act" else None


@pytest.fixture(scope="module")
def page() -> Iterator[Plain]:
    with Plain({"": Answer("text/html", b"here"), "large": Answer("text/plain", bytes(30_000_000))}) as made:
        yield made


def say(page: LocalPage, sent: bytes, *, end: bool = True, timeout: float = 5.0) -> bytes:
    """All that comes back for these bytes."""
    came = b""
    with socket.create_connection(("127.0.0.1", page.port), timeout=timeout) as link:
        try:
            link.sendall(sent)
            if end:
                link.shutdown(socket.SHUT_WR)
            while part := link.recv(1 << 20):
                came += part
        except ConnectionError:  # it was closed before all was sent
            pass
    return came


def get(page: LocalPage, name: str = "", *, token: str | None = None, **headers: str) -> bytes:
    lines = {"Host": page.hosts[0], "Connection": "close"} | {k.replace("_", "-"): v for k, v in headers.items()}
    head = "".join(f"{key}: {value}\r\n" for key, value in lines.items())
    return say(page, f"GET /{page.token if token is None else token}/{name} HTTP/1.1\r\n{head}\r\n".encode())


def malformed(page: LocalPage) -> dict[str, bytes]:
    """Requests that cannot be parsed."""
    at, host = f"/{page.token}/".encode(), f"Host: {page.hosts[0]}\r\n".encode()
    post = b"POST " + at + b"act HTTP/1.1\r\n" + host + f"Origin: http://{page.hosts[0]}\r\n".encode()
    post += b"Content-Type: application/json\r\n"
    return {
        "nothing but letters": b"x\r\n\r\n",
        "four words": b"GET / x HTTP/1.1\r\n\r\n",
        "a version that is none": b"GET " + at + b" HTTP/x\r\n" + host + b"\r\n",
        "a version with digits of another script": "GET / HTTP/١.١\r\n\r\n".encode(),
        "NUL for the method": b"\0 / HTTP/1.1\r\n" + host + b"\r\n",
        "a header without a colon": b"GET " + at + b" HTTP/1.1\r\n" + host + b"nothing\r\n\r\n",
        "a negative length": post + b"Content-Length: -1\r\n\r\n{}",
        "a length that is none": post + b"Content-Length: two\r\n\r\n{}",
        "a length in digits of another script": post + "Content-Length: ٢\r\n\r\n{}".encode(),
        "two lengths": post + b"Content-Length: 2\r\nContent-Length: 40\r\n\r\n{}",
        "chunks": post + b"Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n",
        "a question with a content": b"GET " + at + b" HTTP/1.1\r\n" + host + b"Content-Length: 2\r\n\r\n{}",
    }


@each("what", list(malformed(type("Any", (), {"token": "", "hosts": ("",)})())))
def test_what_cannot_be_parsed_is_answered_by_400(
    page: Plain, what: str, capfd: pytest.CaptureFixture[str]
) -> None:
    came = say(page, malformed(page)[what])
    assert re.match(rb"HTTP/1.1 (400|501) ", came), came[:200]
    assert b"Content-Security-Policy" in came
    assert came.count(b"HTTP/1.1 ") == 1, "what follows is no second request"
    assert capfd.readouterr().err == ""


def test_sizes_are_limited_and_an_error_of_the_page_is_answered(
    page: Plain, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = malformed(page)["a negative length"]
    assert say(page, whole.replace(b"-1", b"9" * 5000)).startswith(b"HTTP/1.1 413 ")
    assert say(page, whole.replace(b"-1", b"70000")).startswith(b"HTTP/1.1 413 ")
    assert say(page, whole.replace(b"-1", b"2")).startswith(b"HTTP/1.1 200 ")
    assert say(page, whole.replace(b"-1", b"20")).startswith(b"HTTP/1.1 400 "), "half a content"
    assert say(page, whole.replace(b"-1", b"2").replace(b"act HTTP", b"fail HTTP")).startswith(b"HTTP/1.1 500 ")
    assert re.match(rb"HTTP/1.1 (414|400) ", say(page, b"GET /" + b"x" * 100_000 + b" HTTP/1.1\r\n\r\n"))
    assert say(page, b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 200 + b"\r\n").startswith(b"HTTP/1.1 431 ")
    assert say(page, b"GET / HTTP/1.1\r\na: " + b"x" * 70_000 + b"\r\n\r\n").startswith(b"HTTP/1.1 431 ")
    assert b"here" in get(page)
    assert capfd.readouterr().err == ""


def test_random_requests_end_neither_the_page_nor_in_a_traceback(
    page: Plain, capfd: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(51)
    seeds = [*malformed(page).values(), f"GET /{page.token}/ HTTP/1.1\r\nHost: {page.hosts[0]}\r\n\r\n".encode()]
    marks = [b"\0", b"\r\n", b"\n", b"\r", b" ", b":", b"//[", b"%00", b"\xff", b"9" * 5000, b"\r\n ", b"?"]
    for _ in range(300):
        sent = bytearray(seeds[rng.integers(len(seeds))])
        for _ in range(rng.integers(1, 4)):
            at = int(rng.integers(len(sent)))
            sent[at : at + int(rng.integers(0, 3))] = marks[rng.integers(len(marks))]
        came = say(page, bytes(sent[: rng.integers(1, len(sent) + 1)]))
        assert came == b"" or came.startswith(b"HTTP/1.1 "), (bytes(sent), came[:100])
    assert b"here" in get(page)
    assert capfd.readouterr().err == ""


def test_slow_senders_and_many_connections_keep_nobody_out(page: Plain, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_page, "TIMEOUT_S", 0.5)
    monkeypatch.setattr(local_page._Handler, "timeout", 0.5)
    before = threading.active_count()
    slow = [socket.create_connection(("127.0.0.1", page.port)) for _ in range(3 * local_page.MAX_OPEN)]
    for link in slow:
        link.sendall(b"GET /slow")
    began = time.monotonic()
    assert b"here" in get(page)
    assert time.monotonic() - began < 0.4
    assert threading.active_count() - before <= local_page.MAX_OPEN + 2
    for link in slow[-2:]:  # a byte now and then does not help
        link.settimeout(5)
        with pytest.raises(OSError):  # noqa: PT011 - a reset or a broken pipe
            for _ in range(20):
                time.sleep(0.05)
                link.sendall(b"x")
    for link in slow:
        link.close()


def test_a_viewer_that_does_not_read_is_let_go(page: Plain, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_page, "TIMEOUT_S", 0.5)
    monkeypatch.setattr(local_page._Handler, "timeout", 0.5)
    before = threading.active_count()
    with socket.create_connection(("127.0.0.1", page.port)) as deaf:
        deaf.sendall(f"GET /{page.token}/large HTTP/1.1\r\nHost: {page.hosts[0]}\r\n\r\n".encode())
        time.sleep(0.2)
        assert b"here" in get(page)
        until = time.monotonic() + 5
        while threading.active_count() > before and time.monotonic() < until:
            time.sleep(0.05)
    assert threading.active_count() <= before


# What is shown live.


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, LiveResult]:
    sensor = load_sensor(saved(tmp_path_factory.mktemp("pages")))
    stream = Stream(sensor)
    stream.take(Frame(free(1)))
    return sensor.reconstructor, LiveResult(Shot(pressed(), 0.0, 7, "a.png"), stream.take(Frame(pressed())), 12.3)


def test_the_cameras_picture_is_given_to_its_own_page_alone(seen: tuple[Any, LiveResult]) -> None:
    with Preview(seen[0], 0) as page:
        page.show(seen[1], 60.0)
        assert get(page, "frame.jpg").startswith(b"HTTP/1.1 200 ")
        assert get(page, "frame.jpg", Sec_Fetch_Site="same-origin").startswith(b"HTTP/1.1 200 ")
        for headers in (
            {"Host": f"rebound.example:{page.port}"},
            {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "image"},
            {"Origin": "http://evil.example"},
            {"Origin": "null"},
        ):
            assert get(page, "frame.jpg", **headers).startswith(b"HTTP/1.1 403 ")
        assert get(page, "frame.jpg", token="").startswith(b"HTTP/1.1 404 ")
        upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Key": "AAAA"}
        assert get(page, **upgrade, Sec_WebSocket_Protocol="foxglove.sdk.v1").startswith(b"HTTP/1.1 400 ")


def test_many_viewers_cost_the_camera_one_drawing(
    seen: tuple[Any, LiveResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tactilevision.robots import preview

    drawn: list[int] = []

    def drawing(rgb: Bytes, *_: object, **__: object) -> Bytes:
        drawn.append(1)
        return rgb

    monkeypatch.setattr(preview, "EVERY_S", 60)
    monkeypatch.setattr(preview, "draw", drawing)
    with Preview(seen[0], 0) as page:
        page.show(seen[1], 60.0)
        viewers = [threading.Thread(target=get, args=(page, "frame.jpg")) for _ in range(8)]
        for viewer in viewers:
            viewer.start()
        for viewer in viewers:
            viewer.join()
    assert len(drawn) == 1


class Socket:
    """A client of a websocket, as a browser is."""

    def __init__(self, port: int, path: str = "/", **headers: str) -> None:
        self.link = socket.create_connection(("127.0.0.1", port), timeout=5)
        lines = {
            "Host": f"127.0.0.1:{port}", "Upgrade": "websocket", "Connection": "Upgrade",
            "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": base64.b64encode(os.urandom(16)).decode(),
            "Sec-WebSocket-Protocol": "foxglove.sdk.v1, foxglove.websocket.v1", **headers,
        }  # fmt: skip
        head = "".join(f"{key}: {value}\r\n" for key, value in lines.items())
        self.link.sendall(f"GET {path} HTTP/1.1\r\n{head}\r\n".encode())
        self.file = self.link.makefile("rb")
        self.status = int(self.file.readline().split()[1])
        while self.file.readline().strip():
            pass

    def hear(self) -> bytes:
        kind, size = self.file.read(2)
        assert kind & 0x80
        if size > 125:
            size = int.from_bytes(self.file.read(2 if size == 126 else 8), "big")
        return self.file.read(size)

    def say(self, content: bytes, kind: int = 1) -> None:
        mask, size = os.urandom(4), len(content)
        head = bytes([0x80 | kind]) + (bytes([0x80 | size]) if size < 126 else b"\xfe" + size.to_bytes(2, "big"))
        self.link.sendall(head + mask + bytes(byte ^ mask[k % 4] for k, byte in enumerate(content)))

    def subscribe(self, channels: list[dict[str, Any]]) -> None:
        asked = [{"id": 10 + k, "channelId": one["id"]} for k, one in enumerate(channels)]
        self.say(json.dumps({"op": "subscribe", "subscriptions": asked}).encode())


def test_foxgloves_websocket_sends_what_its_own_server_would(seen: tuple[Any, LiveResult]) -> None:
    foxglove = pytest.importorskip("foxglove")
    with Foxglove(seen[0], serve=False) as outlet, Streamed(outlet._channels) as page:
        page.port  # noqa: B018
        assert page.address.startswith("ws://127.0.0.1:8765/")
        outlet.page = page
        context = foxglove.Context()
        theirs = {
            topic: foxglove.Channel(
                topic, schema=one.schema(), message_encoding=one.message_encoding, context=context
            )
            for topic, one in outlet._channels.items()
        }
        server = foxglove.start_server(host="127.0.0.1", port=0, context=context)
        ours, reference = Socket(page.port, f"/{page.token}/"), Socket(server.port)
        try:
            assert json.loads(ours.hear())["op"] == json.loads(reference.hear())["op"] == "serverInfo"
            adverts = [
                sorted(json.loads(one.hear())["channels"], key=lambda c: c["topic"]) for one in (ours, reference)
            ]
            keys = ("topic", "encoding", "schemaName", "schema", "schemaEncoding")
            assert [[c[key] for key in keys] for c in adverts[0]] == [[c[key] for key in keys] for c in adverts[1]]
            assert set(adverts[0][0]) == set(adverts[1][0])
            ours.subscribe(adverts[0])
            reference.subscribe(adverts[1])
            ours.say(b"here", 9)
            assert ours.hear() == b"here"
            time.sleep(0.2)
            outlet.show(seen[1], 60.0)
            at_ns, messages = page._newest
            for topic, message in messages.items():
                theirs[topic].log(message, log_time=at_ns)
            assert {ours.hear() for _ in messages} == {reference.hear() for _ in messages}
            assert set(messages) == set(outlet._channels)
        finally:
            ours.link.close()
            ours.file.close()
            reference.link.close()
            reference.file.close()
            server.stop()


def test_foxgloves_websocket_is_opened_by_foxglove_with_the_token_alone(
    seen: tuple[Any, LiveResult], capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("foxglove")
    with Foxglove(seen[0], serve=True) as outlet:
        assert outlet.page is not None
        port, path = outlet.page.port, f"/{outlet.page.token}/"
        for words, status in (
            ({}, 101),
            ({"Origin": "https://app.foxglove.dev", "Sec-Fetch-Site": "cross-site"}, 101),
            ({"Origin": "http://evil.example", "Sec-Fetch-Site": "cross-site"}, 403),
            ({"Origin": "https://foxglove.dev.evil.example"}, 403),
            ({"Origin": "https://evilfoxglove.dev"}, 403),
            ({"Origin": "https://app.foxglove.dev", "Host": f"rebound.example:{port}"}, 403),
        ):
            made = Socket(port, path, **words)
            assert made.status == status
            made.link.close()
            made.file.close()
        other = Socket(port, "/")
        assert other.status == 404
        other.link.close()
        other.file.close()
        deaf = Socket(port, path)
        deaf.hear()
        deaf.subscribe([json.loads(deaf.hear())["channels"][0]])
        began = time.monotonic()
        for _ in range(100):
            outlet.show(seen[1], 60.0)
        assert time.monotonic() - began < 5
        for wrong in (b"\x81\x02{}", b"\x81\xff" + b"\xff" * 12, b"\x01\x80\0\0\0\0", struct.pack("<Q", 0)):
            broken = Socket(port, path)
            broken.link.sendall(wrong)
            while broken.file.read(1):
                pass
            broken.link.close()
            broken.file.close()
        for text in (
            "{",
            "[]",
            '{"op": "subscribe", "subscriptions": 5}',
            '{"op": "subscribe", "subscriptions": [{}]}',
        ):
            broken = Socket(port, path)
            broken.say(text.encode())
            while broken.file.read(1):
                pass
            broken.link.close()
            broken.file.close()
        deaf.link.close()
        deaf.file.close()
    assert "Traceback" not in capfd.readouterr().err


SERVERS = {"http.server", "socketserver", "xmlrpc.server", "wsgiref", "websockets", "aiohttp", "flask", "tornado"}
STARTS = {"bind", "listen", "create_server", "start_server", "start_unix_server", "serve_forever", "fromfd"}


@each("path", sorted(p for n in ("tactilevision", "calibration") for p in (ROOT / n).rglob("*.py")))
def test_no_other_file_starts_a_server(path: Path) -> None:
    found, text = set(), path.read_text()
    named = any(name.split(".")[-1] in text for name in SERVERS | STARTS)  # else there is nothing to look for
    for node in ast.walk(ast.parse(text)) if named else ():
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & SERVERS
        elif isinstance(node, ast.ImportFrom):
            names = {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
            found |= {name for name in names if name in SERVERS or name.split(".")[0] in SERVERS}
        elif isinstance(node, ast.Attribute):
            found |= {node.attr} & STARTS
    assert bool(found) == (path.name == "local_page.py"), found
