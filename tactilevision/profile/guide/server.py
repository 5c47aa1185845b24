"""The guide's page, served on 127.0.0.1 alone, to who knows its address, and to no other page.

The address holds a token drawn anew at each start. Host and Origin are checked, so that no page of another site
can ask, not even by a name that leads here. Nothing is fetched from elsewhere: the page's own rules forbid it.
Names of files reach the page as JSON alone, and it writes them as text.
"""

from __future__ import annotations

import hmac
import json
import secrets
import threading
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from types import TracebackType
from typing import Any, Self

from tactilevision.door.documents import parse_json
from tactilevision.errors import InputError, TactilevisionError
from tactilevision.files import as_json
from tactilevision.profile.guide.session import VIEWS, Session

LOCALHOST = "127.0.0.1"
MAX_BODY = 4096  # bytes of a request; a circle has less than 200
TIMEOUT_S = 30.0  # s that a browser may take to say what it wants
POLL_S = 0.05  # s between two looks at whether the page is to close
PAGES = {
    "": ("page.html", "text/html; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
    "plot.js": ("plot.js", "text/javascript; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
    "icon.svg": ("icon.svg", "image/svg+xml"),
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
Answer = tuple[int, bytes, str]


class Guide:
    """The page while it is open. `wait` returns when a person is done."""

    def __init__(self, session: Session, *, port: int = 0) -> None:
        self.session, self.token, self.done = session, secrets.token_urlsafe(24), threading.Event()
        try:
            self._server = ThreadingHTTPServer((LOCALHOST, port), _handler(self))
        except (OSError, OverflowError) as fault:
            raise InputError(
                "the page's port cannot be used", where="--port", value=port, remedy="Name another, or 0."
            ) from fault
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(POLL_S,), name="guide", daemon=True
        )

    @property
    def address(self) -> str:
        """Where a browser finds it; who has it may draw circles."""
        return f"http://{self.host}/{self.token}/"

    @property
    def host(self) -> str:
        """What a browser names as the host when it asks."""
        return f"{LOCALHOST}:{self.port}"

    def below(self, path: str) -> str | None:
        """What stands below the token in a path; None where that is not the right one."""
        _, token, rest = [*path.partition("?")[0].split("/", 2), "", ""][:3]
        known = hmac.compare_digest(token.encode("utf-8", "replace"), self.token.encode())
        return rest if known else None

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()

    def wait(self) -> None:
        """Until the page says that all is done; Ctrl-C ends it, too."""
        while not self.done.wait(0.5):
            pass

    def get(self, path: str) -> Answer:
        """A file of the page, the presses, a picture or a section."""
        if path in PAGES:
            name, kind = PAGES[path]
            return 200, (files("tactilevision.profile.guide") / "page" / name).read_bytes(), kind
        if path == "presses":
            return _as_answer(self.session.to_json())
        kind_of_view, _, at = path.partition("/")
        if kind_of_view == "section":
            return _as_answer(self.session.section(self._index(at)))
        view = self.session.view(self._index(at), kind_of_view) if kind_of_view in VIEWS else None
        return _refusal(404) if view is None else (200, view, "image/png")

    def post(self, path: str, asked: dict[str, Any]) -> Answer:
        """A circle, a search, a fit, the table, the end."""
        what, _, at = path.partition("/")
        plain: dict[str, Callable[[], dict[str, Any]]] = {"fit": self.session.fit, "save": self.session.save}
        one = {"set": self.session.set, "find": self.session.find}
        if what in plain and not at:
            return _as_answer(plain[what]())
        if what in one:
            return _as_answer(one[what](self._index(at), asked))
        if path == "done":
            answer = _as_answer(self.session.save())
            self.done.set()
            return answer
        return _refusal(404)

    def _index(self, at: str) -> int:
        if not (at.isascii() and at.isdigit() and len(at) < 7 and int(at) < len(self.session.labels)):
            raise InputError("no press of that number", where="the page", value=at[:20])
        return int(at)


def _handler(guide: Guide) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = TIMEOUT_S
        server_version, sys_version = "tactilevision", ""

        def do_GET(self) -> None:
            path = self._path(needs_origin=False)
            self._answer(_refusal(403) if path is None else _asked(lambda: guide.get(path)))

        def do_POST(self) -> None:
            path = self._path(needs_origin=True)
            length = self.headers.get("Content-Length", "")
            if path is None or self.headers.get_content_type() != "application/json":
                self._answer(_refusal(403))
            elif not (length.isdigit() and int(length) <= MAX_BODY):
                self._answer(_refusal(413))
            else:
                body = self.rfile.read(int(length))
                self._answer(_asked(lambda: guide.post(path, parse_json(body, where="the page"))))

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 -- the base class names it so
            """The terminal is for what was found."""

        def _path(self, *, needs_origin: bool) -> str | None:
            """What is asked for, below the token; None for who may not ask."""
            origin = self.headers.get("Origin")
            if self.headers.get("Host") != guide.host or (origin is None and needs_origin):
                return None
            return guide.below(self.path) if origin in (None, f"http://{guide.host}") else None

        def _answer(self, answer: Answer) -> None:
            status, body, kind = answer
            self.send_response(status)
            for name, value in {**HEADERS, "Content-Type": kind, "Content-Length": str(len(body))}.items():
                self.send_header(name, value)
            self.close_connection = True
            with suppress(OSError):  # the browser has gone
                self.end_headers()
                self.wfile.write(body)

    return Handler


def _asked(question: Callable[[], Answer]) -> Answer:
    """The answer, or what was wrong with the question in one sentence."""
    try:
        return question()
    except TactilevisionError as fault:
        return 400, as_json({"fault": str(fault)}).encode(), "application/json"


def _as_answer(content: dict[str, Any]) -> Answer:
    return 200, json.dumps(content, allow_nan=False).encode(), "application/json"


def _refusal(status: int) -> Answer:
    return status, b"refused\n", "text/plain; charset=utf-8"
