"""The workbench's page: its files, the library that draws, what it can ask for, and its actions."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

from calibration.workbench.answers import ANSWERS
from calibration.workbench.bench import Bench
from tactilevision.errors import InputError
from tactilevision.local_page import POLICY, Answer, LocalPage

PAGE = Path(__file__).parent / "page"
PAGE_FILES: Mapping[str, tuple[str, str]] = {
    "": ("page.html", "text/html; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
    "charts.js": ("charts.js", "text/javascript; charset=utf-8"),
    "frames.js": ("frames.js", "text/javascript; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
}
PLOTLY = "plotly.js"
KEPT = {"Cache-Control": "private, max-age=86400"}  # of the library that draws: it is large
PLOTLYS_POLICY = POLICY.replace("style-src 'self'", "style-src 'self' 'unsafe-inline'").replace(
    "img-src 'self'", "img-src 'self' data: blob:"
)  # plotly writes its own styles, and makes pictures in the browser


class Server(LocalPage):
    """The page while it is open."""

    def __init__(self, bench: Bench, port: int = 0) -> None:
        self.bench = bench
        plotly()  # said now where it is missing
        super().__init__(port=port, headers={"Content-Security-Policy": PLOTLYS_POLICY})

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bench.end()
        super().__exit__(kind, fault, trace)

    def get(self, name: str, asked: Mapping[str, str]) -> Answer | dict[str, Any] | None:
        if name in PAGE_FILES:
            file, kind = PAGE_FILES[name]
            return Answer(kind, (PAGE / file).read_bytes())
        if name == PLOTLY:
            return Answer("text/javascript; charset=utf-8", plotly(), KEPT)
        return ANSWERS[name](self.bench, asked) if name in ANSWERS else None

    def post(self, name: str, content: dict[str, Any]) -> dict[str, Any] | None:
        if name != "act":
            return None
        action, value, version = content["action"], content.get("value", ""), content["version"]
        if not (isinstance(action, str) and isinstance(value, str)) or type(version) is not int:
            raise ValueError("an action has a name, a value and a version")
        self.bench.act(action, value, version=version)
        return {}


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
