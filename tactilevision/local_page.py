"""A page served on 127.0.0.1 only, to those who know the token in its address.

A request is answered if its Host is this server's, its path begins with the token, and its Origin and
Sec-Fetch-Site are this page's. Content-Security-Policy keeps the page from loading anything elsewhere. No path of
a request is opened: what is served has a fixed name.
"""

from __future__ import annotations

import hmac
import secrets
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from mimetypes import MimeTypes
from pathlib import Path
from typing import Any, Self
from urllib.parse import parse_qs, urlsplit

from tactilevision.errors import InputError, TactilevisionError
from tactilevision.files.documents import parse_json
from tactilevision.files.writing import PAUSE_S, as_json

LOCALHOST = "127.0.0.1"
MAX_BODY = 65536  # bytes of a request; an action has less than a thousand
TIMEOUT_S = 60  # s that a browser may take to send a request
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
KINDS = MimeTypes()  # by the endings of files, without those that this machine adds
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


class LocalPage(ABC):
    """An open page of `files` by name; subclasses define `get` for other names, and `post`.

    Each returns an Answer, a dictionary that is sent as JSON, or None for an unknown name. An InputError is
    reported by its message, a KeyError, ValueError or TypeError as a request that is not understood.
    """

    def __init__(
        self,
        files: Mapping[str, Answer],
        *,
        port: int = 0,
        headers: Mapping[str, str] | None = None,
        option: str = "--port",
    ) -> None:
        self.files, self.headers = files, {**HEADERS, **(headers or {})}
        self.token = secrets.token_urlsafe(24)
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

    @abstractmethod
    def get(self, name: str, asked: Mapping[str, str]) -> Answer | dict[str, Any] | None:
        """Answer a request for `name`, the path below the token; `asked` holds the parameters after "?"."""

    @abstractmethod
    def post(self, name: str, content: dict[str, Any]) -> Answer | dict[str, Any] | None:
        """Answer a request for `name`, the path below the token, with the JSON `content`."""

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
    """Server with one thread for each request."""

    daemon_threads = True

    def __init__(self, place: tuple[str, int], page: LocalPage) -> None:
        self.page = page
        super().__init__(place, _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a browser that disconnects during a request; report all other errors as usual."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Handler of one request."""

    protocol_version = "HTTP/1.1"
    timeout = TIMEOUT_S
    server_version, sys_version = "tactilevision", ""
    server: _Listener

    def do_GET(self) -> None:
        parts = urlsplit(self.path)
        name = self._let_in(parts.path, post=False)
        if name is not None:
            asked = {key: values[-1] for key, values in parse_qs(parts.query).items()}
            page = self.server.page
            self._answer(lambda: page.files.get(name) or page.get(name, asked))

    def do_POST(self) -> None:
        name = self._let_in(self.path, post=True)
        size = self.headers.get("Content-Length", "")
        if name is None:
            return
        if self.headers.get_content_type() != "application/json":
            self._refuse(403, "an action is sent as application/json")
        elif not (size.isascii() and size.isdecimal() and int(size) <= MAX_BODY):
            self._refuse(413, "an action is short")
        else:
            body = self.rfile.read(int(size))
            self._answer(lambda: self.server.page.post(name, parse_json(body, where="the page")))

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 -- the base class names it so
        """Log nothing: the terminal is for what the user should see."""

    def _let_in(self, path: str, *, post: bool) -> str | None:
        """Return the name asked for under the token; None if the request is refused."""
        page = self.server.page
        _, token, *rest = [*path.split("/", 2), "", ""]
        if not _comes_from_page(self.headers, page.hosts, post=post):
            self._refuse(403, "this page answers its own requests only")
        elif not hmac.compare_digest(token.encode("utf-8", "replace"), page.token.encode()):
            self._refuse(404, "the address has no token, or another's: open the one that was printed")
        else:
            return rest[0]
        return None

    def _answer(self, make: Callable[[], Answer | dict[str, Any] | None]) -> None:
        """Send what was asked for, or one sentence on what is wrong with the request."""
        try:
            made = make()
        except TactilevisionError as fault:
            self._refuse(409, str(fault))
        except (KeyError, ValueError, TypeError) as fault:
            self._refuse(400, f"the request is not understood: {fault}")
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


def _comes_from_page(headers: Any, hosts: tuple[str, ...], *, post: bool) -> bool:
    """Return whether a request is this page's own, or of a person who opens its address.

    Origin or Sec-Fetch-Site shows another site's page, Host a foreign name that resolves to this machine.
    """
    if headers.get("Host") not in hosts:
        return False
    if headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none"):
        return False
    origin = headers.get("Origin")
    return origin in [f"http://{host}" for host in hosts] if post or origin is not None else True
