"""The guide's page: what it can ask for, and what it can do. Names of files reach it as JSON alone."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any

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


class Guide(LocalPage):
    """The page while it is open. `wait` returns when a person is done."""

    def __init__(self, session: Session, *, port: int = 0) -> None:
        self.session, self.done = session, threading.Event()
        super().__init__(port=port)

    def wait(self) -> None:
        """Until the page says that all is done; Ctrl-C ends it, too."""
        while not self.done.wait(0.5):
            pass

    def get(self, name: str, asked: Mapping[str, str]) -> Answer | dict[str, Any] | None:
        """A file of the page, the presses, a picture or a section."""
        if name in PAGES:
            file, kind = PAGES[name]
            return Answer(kind, (files("tactilevision.profile.guide") / "page" / file).read_bytes())
        if name == "presses":
            return self.session.to_json()
        kind_of_view, _, at = name.partition("/")
        if kind_of_view == "section":
            return self.session.section(self._index(at))
        view = self.session.view(self._index(at), kind_of_view) if kind_of_view in VIEWS else None
        return None if view is None else Answer("image/png", view)

    def post(self, name: str, content: dict[str, Any]) -> dict[str, Any] | None:
        """A circle, a search, a fit, the table, the end."""
        what, _, at = name.partition("/")
        plain: dict[str, Callable[[], dict[str, Any]]] = {"fit": self.session.fit, "save": self.session.save}
        one = {"set": self.session.set, "find": self.session.find}
        if what in plain and not at:
            return plain[what]()
        if what in one:
            return one[what](self._index(at), content)
        if name == "done":
            kept = self.session.save()
            self.done.set()
            return kept
        return None

    def _index(self, at: str) -> int:
        if not (at.isascii() and at.isdigit() and len(at) < 7 and int(at) < len(self.session.labels)):
            raise InputError("no press of that number", where="the page", value=at[:20])
        return int(at)
