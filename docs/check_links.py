"""Walks a built site and lists links to pages and anchors that do not exist: `python check_links.py SITE`."""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

NOT_PAGES = ("genindex", "search", "_modules", "_static")  # Sphinx's own: filled in by script, templates


class Page(HTMLParser):
    """What one page links to, and what in it can be linked to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = {"", "top"}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for key, value in attrs:
            if value and key in ("id", "name"):
                self.anchors.add(value)
            if value and ((tag in ("a", "link") and key == "href") or (tag in ("img", "script") and key == "src")):
                self.links.append(value)


def dead_links(site: Path) -> list[str]:
    """`PAGE -> LINK` for every internal link that leads nowhere."""
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    dead = []
    for path, page in pages.items():
        if path.relative_to(site.resolve()).parts[0].startswith(NOT_PAGES):
            continue
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            known = target in pages and unquote(parts.fragment) in pages[target].anchors
            if not (known or (target not in pages and target.is_file())):
                dead.append(f"{path.relative_to(site.resolve())} -> {link}")
    return sorted(set(dead))


def main() -> int:
    dead = dead_links(Path(sys.argv[1]))
    for line in dead:
        print(line, file=sys.stderr)
    return 1 if dead else 0


if __name__ == "__main__":
    sys.exit(main())
