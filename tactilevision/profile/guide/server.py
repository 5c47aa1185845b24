"""The guide's page: what it can ask for, and what it can do. Names of files reach it as JSON alone."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from importlib.resources import files
from types import TracebackType
from typing import Any, Self

from tactilevision.errors import InputError
from tactilevision.local_page import Answer, LocalPage
from tactilevision.profile.guide.session import VIEWS, Session

PAGES = {
    "": ("page.html", "text/html; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
    "plot.js": ("plot.js", "text/javascript; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
    "icon.svg": ("icon.svg", "image/svg+xml"),
}


class Guide:
    """The page while it is open. `wait` returns when a person is done."""

    def __init__(self, session: Session, *, port: int = 0) -> None:
        self.session, self.done = session, threading.Event()
        self.page = LocalPage(self.get, self.post, port=port)

    @property
    def address(self) -> str:
        """Where a browser finds it; who has it may draw circles."""
        return self.page.address

    def __enter__(self) -> Self:
        self.page.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.page.__exit__(kind, fault, trace)

    def wait(self) -> None:
        """Until the page says that all is done; Ctrl-C ends it, too."""
        while not self.done.wait(0.5):
            pass

    def get(self, path: str, asked: Mapping[str, str]) -> Answer | dict[str, Any] | None:
        """A file of the page, the presses, a picture or a section."""
        if path in PAGES:
            name, kind = PAGES[path]
            return Answer(kind, (files("tactilevision.profile.guide") / "page" / name).read_bytes())
        if path == "presses":
            return self.session.to_json()
        kind_of_view, _, at = path.partition("/")
        if kind_of_view == "section":
            return self.session.section(self._index(at))
        view = self.session.view(self._index(at), kind_of_view) if kind_of_view in VIEWS else None
        return None if view is None else Answer("image/png", view)

    def post(self, path: str, asked: dict[str, Any]) -> dict[str, Any] | None:
        """A circle, a search, a fit, the table, the end."""
        what, _, at = path.partition("/")
        plain: dict[str, Callable[[], dict[str, Any]]] = {"fit": self.session.fit, "save": self.session.save}
        one = {"set": self.session.set, "find": self.session.find}
        if what in plain and not at:
            return plain[what]()
        if what in one:
            return one[what](self._index(at), asked)
        if path == "done":
            kept = self.session.save()
            self.done.set()
            return kept
        return None

    def _index(self, at: str) -> int:
        if not (at.isascii() and at.isdigit() and len(at) < 7 and int(at) < len(self.session.labels)):
            raise InputError("no press of that number", where="the page", value=at[:20])
        return int(at)
