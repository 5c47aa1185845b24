"""The page's server: on this machine alone, for whoever knows the token in its address.

A request is answered where its Host is this server's own, its path begins with the token, and a browser says that
it comes from this page (Origin, Sec-Fetch-Site). Nothing is read from a path that a request names: a page's file
and an answer have one fixed name each. The page may load and ask nothing elsewhere (Content-Security-Policy).
"""

from __future__ import annotations

import hmac
import json
import secrets
import threading
from collections.abc import Callable, Mapping
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import parse_qs, urlsplit

from calibration.workbench.answers import ANSWERS, Answer
from calibration.workbench.bench import Bench
from tactilevision.door.documents import parse_json
from tactilevision.errors import InputError, TactilevisionError
from tactilevision.files import as_json

LARGEST = 65536  # bytes of an action: a name and a number
TIMEOUT_S = 60.0  # s that a browser may take to say what it wants
PAGE = Path(__file__).parent / "page"
PAGE_FILES: Mapping[str, tuple[str, str]] = {
    "": ("page.html", "text/html; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
    "charts.js": ("charts.js", "text/javascript; charset=utf-8"),
    "frames.js": ("frames.js", "text/javascript; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
}
PLOTLY = "plotly.js"
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class Server:
    """The page while it is open."""

    def __init__(self, bench: Bench, port: int = 0) -> None:
        self.bench, self.token = bench, secrets.token_urlsafe(24)
        plotly()  # said now where it is missing
        try:
            self._server = _Listener(("127.0.0.1", port), self)
        except (OSError, OverflowError) as fault:
            raise InputError(
                "the workbench's port cannot be used", where="--port", value=port, remedy="Name another, or 0."
            ) from fault
        self._thread = threading.Thread(target=self._server.serve_forever, name="workbench", daemon=True)

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._server.server_address[1])

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://127.0.0.1:{self.port}/{self.token}/"

    @property
    def hosts(self) -> tuple[str, str]:
        """What a browser of this machine calls it."""
        return f"127.0.0.1:{self.port}", f"localhost:{self.port}"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bench.end()
        self._server.shutdown()
        self._server.server_close()


@cache
def plotly() -> bytes:
    """The library that draws, from the installed package. Raises InputError where there is none."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as fault:
        raise InputError(
            "the workbench draws with plotly, which is not installed",
            where="workbench",
            remedy="pip install 'tactilevision[workbench]'",
        ) from fault
    return str(get_plotlyjs()).encode()


class _Listener(ThreadingHTTPServer):
    """Whoever asks has a thread of their own."""

    daemon_threads = True

    def __init__(self, place: tuple[str, int], page: Server) -> None:
        self.page = page
        super().__init__(place, _Handler)


class _Handler(BaseHTTPRequestHandler):
    """One request."""

    protocol_version = "HTTP/1.1"
    timeout = TIMEOUT_S
    server: _Listener

    def do_GET(self) -> None:
        name, asked = self._let_in(post=False)
        if name is not None:
            self._get(name, asked)

    def do_POST(self) -> None:
        name, _ = self._let_in(post=True)
        if name is not None:
            self._post(name)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 -- the base class names it so
        """The terminal is for what the user should see."""

    def _let_in(self, *, post: bool) -> tuple[str | None, dict[str, str]]:
        """What is asked for under the token, with its parameters; None where the request is turned away."""
        page, parts = self.server.page, urlsplit(self.path)
        _, token, *rest = [*parts.path.split("/", 2), ""]
        if not comes_from_page(self.headers, page.hosts, post=post):
            self._refuse(403, "this page answers its own requests alone")
        elif not hmac.compare_digest(token.encode(), page.token.encode()):
            self._refuse(404, "the address has no token, or another's: open the one that was printed")
        else:
            return rest[0], {key: values[-1] for key, values in parse_qs(parts.query).items()}
        return None, {}

    def _get(self, name: str, asked: dict[str, str]) -> None:
        if name in PAGE_FILES:
            file, kind = PAGE_FILES[name]
            self._whole(200, kind, (PAGE / file).read_bytes())
        elif name == PLOTLY:
            self._whole(200, "text/javascript; charset=utf-8", plotly(), keep=True)
        elif name in ANSWERS:
            self._answer(lambda: ANSWERS[name](self.server.page.bench, asked))
        else:
            self._refuse(404, "there is no such page")

    def _post(self, name: str) -> None:
        size = self.headers.get("Content-Length", "")
        if not size.isdecimal() or int(size) > LARGEST:
            self._refuse(413, "an action is short")
            return
        body = self.rfile.read(int(size))
        if name != "act" or self.headers.get_content_type() != "application/json":
            self._refuse(404, "there is no such action")
            return
        self._answer(lambda: _act(self.server.page.bench, parse_json(body, where="the page")))

    def _answer(self, make: Callable[[], Answer | dict[str, Any]]) -> None:
        try:
            made = make()
        except TactilevisionError as fault:
            self._refuse(409, str(fault))
        except (KeyError, ValueError, TypeError) as fault:
            self._refuse(400, f"the request is not understood: {fault}")
        else:
            if isinstance(made, dict):
                made = Answer("application/json", as_json(made).encode())
            self._whole(200, made.kind, made.content, more=made.headers)

    def _refuse(self, status: int, why: str) -> None:
        self.close_connection = True
        self._whole(status, "application/json", json.dumps({"error": why}).encode())

    def _whole(
        self, status: int, kind: str, content: bytes, *, more: Mapping[str, str] | None = None, keep: bool = False
    ) -> None:
        kept = "private, max-age=86400" if keep else "no-store"
        head = {"Content-Type": kind, "Content-Length": str(len(content)), "Cache-Control": kept}
        try:
            self.send_response(status)
            for key, value in {**HEADERS, **head, **(more or {})}.items():
                self.send_header(key, value)
            self.end_headers()
            self.wfile.write(content)
        except OSError:  # the browser has gone
            self.close_connection = True


def comes_from_page(headers: Any, hosts: tuple[str, ...], *, post: bool) -> bool:
    """Whether a request is this page's own, or of a person who opens its address.

    Another site's page is known by its Origin, or by Sec-Fetch-Site; a name that was made to lead here, by Host.
    """
    if headers.get("Host") not in hosts:
        return False
    if headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none"):
        return False
    origin = headers.get("Origin")
    return origin in [f"http://{host}" for host in hosts] if post or origin is not None else True


def _act(bench: Bench, content: dict[str, Any]) -> dict[str, Any]:
    action, value, version = content["action"], content.get("value", ""), content["version"]
    if not (isinstance(action, str) and isinstance(value, str)) or type(version) is not int:
        raise ValueError("an action has a name, a value and a version")
    bench.act(action, value, version=version)
    return {}
