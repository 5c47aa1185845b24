"""A page served on 127.0.0.1 only, to those who know the token in its address.

A request is answered if its Host is this server's, its path begins with the token, and its Origin and
Sec-Fetch-Site are this page's. Content-Security-Policy keeps the page from loading anything elsewhere. No path of
a request is opened: what is served has a fixed name. A request must arrive within TIMEOUT_S; beyond MAX_OPEN
connections those without a request are closed, the oldest first. A websocket passes the same checks.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import math
import re
import secrets
import select
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from mimetypes import MimeTypes
from pathlib import Path
from typing import Any, ClassVar, Self
from urllib.parse import parse_qs

from tactilevision.errors import InputError, TactilevisionError
from tactilevision.files.documents import parse_json
from tactilevision.files.writing import PAUSE_S, as_json

LOCALHOST = "127.0.0.1"
MAX_BODY = 65536  # bytes of a request; an action has less than a thousand
TIMEOUT_S = 10  # s that a browser may take to send a request, or to take an answer
MAX_OPEN = 32  # connections at a time; a browser opens six
MAX_DIGITS = 9  # of a request's length
LINGER_S = 0.2  # s that the rest of a refused request may pause
LINGER_PARTS = 4  # of a refused request are read at most
STREAM_S = 0.01  # s between two messages of a websocket at least
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
KINDS = MimeTypes()  # by the endings of files, without those that this machine adds
FRAMED = "frame-ancestors http://127.0.0.1:* http://localhost:*"  # pages of this machine, as notebooks are
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


@dataclass(frozen=True, slots=True)
class Answer:
    """Bytes of a content type, with further headers."""

    kind: str
    content: bytes
    headers: Mapping[str, str] = field(default_factory=dict)


def page_files(folder: Path) -> dict[str, Answer]:
    """Return the files of a page by their names; page.html is the page itself."""
    paths = {"" if path.name == "page.html" else path.name: path for path in folder.iterdir()}
    kinds = {name: f"{KINDS.guess_type(path.name)[0]}; charset=utf-8" for name, path in paths.items()}
    return {name: Answer(kinds[name], path.read_bytes()) for name, path in paths.items()}


class LocalPage:
    """An open page of `files` by name; subclasses define `get` for other names, `post`, and `converse`.

    The first two return an Answer, a dictionary that is sent as JSON, or None for an unknown name. An InputError
    is reported by its message, a KeyError, ValueError or TypeError as a request that is not understood.
    `protocols` are those of a websocket that `converse` speaks, `origins` the foreign pages that may open one.
    With `framed`, other pages of this machine may show it in a frame. `token`: that of a page that was open
    before.
    """

    protocols: ClassVar[tuple[str, ...]] = ()
    origins: ClassVar[re.Pattern[str]] = re.compile(r"(?!)")  # none

    def __init__(
        self,
        files: Mapping[str, Answer],
        *,
        port: int = 0,
        headers: Mapping[str, str] | None = None,
        option: str = "--port",
        framed: bool = False,
        token: str = "",
    ) -> None:
        self.files, self.headers, self.framed = files, {**HEADERS, **(headers or {})}, framed
        if framed:
            policy = self.headers["Content-Security-Policy"].replace("frame-ancestors 'none'", FRAMED)
            self.headers["Content-Security-Policy"] = policy
        self.token = token or secrets.token_urlsafe(24)
        try:
            self._server = _Listener((LOCALHOST, port), self)
        except (OSError, OverflowError) as fault:
            raise InputError(
                "the page's port cannot be used", where=option, value=port, remedy="Name another, or 0."
            ) from fault
        self.port = int(self._server.server_address[1])
        self.hosts = f"{LOCALHOST}:{self.port}", f"localhost:{self.port}"
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(PAUSE_S,), name="local page", daemon=True
        )

    def get(self, name: str, asked: Mapping[str, str]) -> Answer | dict[str, Any] | None:
        """Answer a request for `name`, the path below the token; `asked` holds the parameters after "?"."""
        return None

    def post(self, name: str, content: dict[str, Any]) -> Answer | dict[str, Any] | None:
        """Answer a request for `name`, the path below the token, with the JSON `content`."""
        return None

    def converse(self, link: Link) -> None:
        """Receive and send messages over a websocket; it is closed when this returns or raises OSError."""

    @property
    def address(self) -> str:
        """URL of the page with its token."""
        return f"http://{self.hosts[0]}/{self.token}/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *fault: object) -> None:
        self._server.shutdown()
        self._server.server_close()


class _Listener(ThreadingHTTPServer):
    """Server with one thread for each of at most MAX_OPEN connections."""

    daemon_threads = True
    request_queue_size = MAX_OPEN

    def __init__(self, place: tuple[str, int], page: LocalPage) -> None:
        self.page, self._lock = page, threading.Lock()
        self._until_s: dict[Any, float] = {}  # by connection: when its request must have come
        super().__init__(place, _Handler)

    def answering(self, connection: Any, now: bool) -> None:
        """Note whether a connection's request is complete, and so may take its time."""
        with self._lock:
            if connection in self._until_s:
                self._until_s[connection] = math.inf if now else time.monotonic() + TIMEOUT_S

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own."""
        with self._lock:
            self._until_s[request] = time.monotonic() + TIMEOUT_S
        super().process_request(request, client_address)

    def service_actions(self) -> None:
        """End connections whose request is late and, beyond MAX_OPEN, those that have waited for the longest."""
        with self._lock:
            surplus, now_s = len(self._until_s) - MAX_OPEN, time.monotonic()
            idle = sorted((until, id(one), one) for one, until in self._until_s.items() if until < math.inf)
            ended = [one for place, (until, _, one) in enumerate(idle) if place < surplus or until < now_s]
            for one in ended:
                del self._until_s[one]
        for one in ended:
            with suppress(OSError):  # it has ended
                one.shutdown(socket.SHUT_RDWR)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection after what has come, for else the system may drop the answer."""
        self.answering(request, False)
        with suppress(OSError):  # it has ended, or sends nothing
            request.shutdown(socket.SHUT_WR)
            request.settimeout(LINGER_S)
            any(not request.recv(MAX_BODY) for _ in range(LINGER_PARTS))
        with self._lock:
            self._until_s.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a connection that ends during a request; report all other errors as usual."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Handler of one connection."""

    protocol_version = default_request_version = "HTTP/1.1"
    timeout = TIMEOUT_S
    server_version, sys_version = "tactilevision", ""
    server: _Listener

    def handle_one_request(self) -> None:
        self.server.answering(self.connection, False)
        super().handle_one_request()

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        stream = self.headers.get("Upgrade", "").lower() == "websocket"
        name = self._let_in(path, post=False, stream=stream)
        if name is None:
            return
        if stream:
            self._converse()
            return
        asked = {key: values[-1] for key, values in parse_qs(query).items()}
        page = self.server.page
        self._answer(lambda: page.files.get(name) or page.get(name, asked))

    def do_POST(self) -> None:
        name = self._let_in(self.path, post=True)
        if name is None:
            return
        if self.headers.get_content_type() != "application/json":
            self._refuse(403, "an action is sent as application/json")
        elif self._size > MAX_BODY:
            self._refuse(413, "an action is short")
        else:
            body = self.rfile.read(self._size)
            if len(body) < self._size:
                self._refuse(400, "the request ends early")
                return
            self._answer(lambda: self.server.page.post(name, parse_json(body, where="the page")))

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 -- the base class names it so
        """Log nothing: the terminal is for what the user should see."""

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse a request that cannot be parsed."""
        self._refuse(code, message or "the request cannot be parsed")

    @property
    def _size(self) -> int:
        """Length of a request's content; -1 where it is unclear."""
        stated = self.headers.get_all("Content-Length", ["0"])
        plain = len(stated) == 1 and stated[0].isascii() and stated[0].isdecimal()
        if not plain or self.headers.defects or "Transfer-Encoding" in self.headers:
            return -1
        return int(stated[0][: MAX_DIGITS + 1])

    def _let_in(self, path: str, *, post: bool, stream: bool = False) -> str | None:
        """Return the name asked for under the token; None if the request is refused."""
        page = self.server.page
        _, token, *rest = [*path.split("/", 2), "", ""]
        if self._size < 0 or (self._size and not post):
            self._refuse(400, "the request cannot be parsed")
        elif not _comes_from_page(self.headers, page, post=post, stream=stream):
            self._refuse(403, "this page answers its own requests only")
        elif not hmac.compare_digest(token.encode("utf-8", "replace"), page.token.encode()):
            self._refuse(404, "the address has no token, or another's: open the one that was printed")
        else:
            return rest[0]
        return None

    def _converse(self) -> None:
        """Open a websocket and let the page converse."""
        offered = [one.strip() for one in self.headers.get("Sec-WebSocket-Protocol", "").split(",")]
        chosen = next((one for one in self.server.page.protocols if one in offered), None)
        key = self.headers.get("Sec-WebSocket-Key", "")
        if chosen is None or not key:
            self._refuse(400, "this page has no such stream")
            return
        accept = hashlib.sha1((key + _GUID).encode(), usedforsecurity=False).digest()
        head = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Protocol": chosen}
        self.send_response(101)
        for name, value in {**head, "Sec-WebSocket-Accept": base64.b64encode(accept).decode()}.items():
            self.send_header(name, value)
        self.end_headers()
        self.server.answering(self.connection, True)
        self.close_connection = True
        with suppress(Exception):  # it ended, or sent what the page does not understand
            self.server.page.converse(Link(self._received, self.wfile.write))

    def _received(self) -> bytes | None:
        """Return bytes that have come within STREAM_S; empty at the end of the connection."""
        came, _, _ = select.select([self.connection], [], [], STREAM_S)
        return self.connection.recv(MAX_BODY) if came else None

    def _answer(self, make: Callable[[], Answer | dict[str, Any] | None]) -> None:
        """Send what was asked for, or one sentence on what is wrong with the request."""
        self.server.answering(self.connection, True)
        try:
            made = make()
        except TactilevisionError as fault:
            self._refuse(409, str(fault))
        except (KeyError, ValueError, TypeError) as fault:
            self._refuse(400, f"the request is not understood: {fault}")
        except Exception as fault:  # the page lives on
            self._refuse(500, f"the request failed: {type(fault).__name__}: {fault}")
        else:
            if made is None:
                self._refuse(404, "there is no such page or action")
            else:
                self._send(200, made if isinstance(made, Answer) else _json(made))

    def _refuse(self, status: int, why: str) -> None:
        self.close_connection = True
        self._send(status, _json({"error": why}))

    def _send(self, status: int, answer: Answer) -> None:
        head = {"Content-Type": answer.kind, "Content-Length": str(len(answer.content))}
        with suppress(OSError):  # the browser has gone
            self.send_response(status)
            for name, value in {**self.server.page.headers, **head, **answer.headers}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(answer.content)
            return
        self.close_connection = True


def _json(content: dict[str, Any]) -> Answer:
    return Answer("application/json", as_json(content).encode())


def _comes_from_page(headers: Any, page: LocalPage, *, post: bool, stream: bool) -> bool:
    """Return whether a request is this page's own, of one of its `origins`, or of a person who opens its address.

    Of a `framed` page also that of a page which opens it in a frame; the policy then says which one may show it.

    Origin or Sec-Fetch-Site shows another site's page, Host a foreign name that resolves to this machine.
    """
    if headers.get_all("Host", []) not in [[host] for host in page.hosts]:
        return False
    if stream and page.origins.fullmatch(headers.get("Origin", "")):
        return True
    opens = (headers.get("Sec-Fetch-Dest"), headers.get("Sec-Fetch-Mode")) == ("iframe", "navigate")
    if page.framed and opens and not post:
        return True
    if headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none"):
        return False
    origin = headers.get("Origin")
    return origin in [f"http://{host}" for host in page.hosts] if post or origin is not None else True


# Messages over a websocket (RFC 6455): unfragmented ones of at most MAX_BODY from a browser, any size to it.

_GUID = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  # of RFC 6455, section 1.3
TEXT = 1  # kind of a message: UTF-8
BINARY = 2  # kind of a message: bytes
_CLOSE = 8  # kind of a message: the end
_PING = 9  # kind of a message: to be answered by the next kind
_LONG = {126: 2, 127: 8}  # bytes of a length that seven bits do not hold
_LAST = 0x80  # bit of an unfragmented message; of a masked one in the next byte


class Link:
    """An open websocket: `read` returns bytes that came, None if none did, empty at the end."""

    def __init__(self, read: Callable[[], bytes | None], write: Callable[[bytes], object]) -> None:
        self._read, self._write, self._came = read, write, b""

    def send(self, content: bytes, kind: int = BINARY) -> None:
        """Send a message; raises OSError where the browser does not take it."""
        size = len(content)
        short = size if size < min(_LONG) else 126 if size < 1 << 16 else 127
        length = size.to_bytes(_LONG[short], "big") if short in _LONG else b""
        self._write(bytes([_LAST | kind, short]) + length + content)

    def receive(self) -> bytes | None:
        """Return the next message, None if none has come within STREAM_S.

        Raises ConnectionError at the end, and for what is no message of a browser.
        """
        came = self._read()
        if came == b"":
            raise ConnectionError
        self._came += came or b""
        if len(self._came) < 2:
            return None
        kind, short = self._came[0] & 0xF, self._came[1] & 0x7F
        begin = 2 + _LONG.get(short, 0)
        size = int.from_bytes(self._came[2:begin], "big") if short in _LONG else short
        if not (self._came[0] & _LAST and self._came[1] & _LAST) or size > MAX_BODY or kind == _CLOSE:
            raise ConnectionError
        if len(self._came) < begin + 4 + size:
            return None
        mask, masked = self._came[begin : begin + 4], self._came[begin + 4 : begin + 4 + size]
        content = bytes(byte ^ mask[k % 4] for k, byte in enumerate(masked))
        self._came = self._came[begin + 4 + size :]
        if kind == _PING:
            self.send(content, _PING + 1)
        return content if kind in (TEXT, BINARY) else None
