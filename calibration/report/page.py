"""Parts of one self-contained HTML page: no second file, no script, no request; prints well."""

from __future__ import annotations

from collections.abc import Sequence

from tactilevision.files.documents import html_text as escape

NARROW = 5  # columns of a table that fit a phone

STYLE = """
:root { color-scheme: light dark; --paper: #ffffff; --panel: #f6f6f4; --ink: #1c1c1c; --soft: #5c5c5c;
        --line: #dcdcdc; --good: #00694d; --bad: #a84300; }
@media screen and (prefers-color-scheme: dark) {
  :root { --paper: #16181a; --panel: #202326; --ink: #ececec; --soft: #b0b0b0; --line: #3d4246;
          --good: #4fc79f; --bad: #ff9e57; } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
       max-width: 1180px; margin: 2rem auto; padding: 0 1rem; overflow-wrap: break-word; }
h1 { font-size: 1.5rem; margin-bottom: .2rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
p.lead { font-size: 1.1rem; }
div.verdict { border-left: 6px solid var(--soft); background: var(--panel);
       padding: .6rem 1.1rem; margin: 1rem 0; }
div.verdict.found { border-color: var(--bad); } div.verdict.clean { border-color: var(--good); }
div.verdict b { letter-spacing: .04em; } div.verdict p { margin: .35rem 0; }
div.card { border: 1px solid var(--line); padding: .3rem 1rem .6rem; margin: .8rem 0; break-inside: avoid; }
div.card h3 { font-size: 1.02rem; margin: .5rem 0; }
div.card figure { float: right; max-width: 46%; margin: 0 0 0 1.5rem; }
div.card::after { content: ""; display: block; clear: both; }
.soft { color: var(--soft); } .good { color: var(--good); } .bad { color: var(--bad); }
table { border-collapse: collapse; margin: .6rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .7rem; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { font-weight: 600; } td.number { text-align: right; white-space: nowrap; }
figure { margin: .8rem 0; } figcaption { color: var(--soft); }
figure img { max-width: 100%; height: auto; display: block; cursor: zoom-in;
       background: white; border-radius: 4px; }
figure input { position: absolute; opacity: 0; }
figure input:focus-visible + img { outline: 2px solid var(--soft); }
@media (min-width: 62rem) {
  body > figure, details > figure { display: grid; grid-template-columns: 45rem 1fr; gap: 1.5rem; } }
@media screen {
  figure label:has(:checked) { position: fixed; inset: 0; z-index: 1; overflow: auto; background: white; }
  figure label:has(:checked) img { width: max(100%, 56rem); max-width: none; cursor: zoom-out; } }
@media (max-width: 45rem) {
  body { margin: 1rem auto; } th, td { padding: .25rem .35rem; } table { font-size: .93em; }
  table.wide thead { display: none; } table.wide td { display: block; border: 0; padding: .05rem .35rem; }
  table.wide td:empty { display: none; } table.wide td.number { text-align: left; white-space: normal; }
  table.wide td[data-of]::before { content: attr(data-of) ": "; color: var(--soft); }
  table.wide td:first-child { font-weight: 600; margin-top: .6rem; border-top: 1px solid var(--line); }
  table.wide td:first-child::before { content: none; }
  div.card figure { float: none; max-width: 100%; margin: 0; }
  figcaption::after { content: " Tap the picture to enlarge it."; } }
details { margin: .8rem 0; } summary { cursor: pointer; font-weight: 600; }
pre { background: var(--panel); padding: .5rem .9rem; overflow-x: auto; font-size: .9em; }
div.table { overflow-x: auto; }
ul { padding-left: 1.2rem; } code { font-size: .92em; }
"""


def page(title: str, *sections: str) -> str:
    """Return the whole page."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body>\n<h1>{escape(title)}</h1>\n"
        + "\n".join(sections)
        + "\n</body></html>\n"
    )


def section(title: str, *parts: str) -> str:
    """Return a heading with its parts; nothing without parts."""
    body = "\n".join(part for part in parts if part)
    return f"<h2>{escape(title)}</h2>\n{body}" if body else ""


def paragraph(text: str, *, kind: str = "") -> str:
    """Return a paragraph of escaped text; `kind` is a class of STYLE."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def block(kind: str, *parts: str) -> str:
    """Return parts in one box; `kind` is a class of STYLE."""
    return f'<div class="{kind}">' + "\n".join(part for part in parts if part) + "</div>"


def heading(text: str) -> str:
    """Return a small heading for a box."""
    return f"<h3>{escape(text)}</h3>"


def folded(summary: str, *parts: str) -> str:
    """Return parts that a click on the summary unfolds; nothing without parts."""
    body = "\n".join(part for part in parts if part)
    return f"<details><summary>{escape(summary)}</summary>\n{body}\n</details>" if body else ""


def command(text: str) -> str:
    """Return a command to copy."""
    lines = "\n".join(map(escape, text.split("\n")))
    return f"<pre>{lines}</pre>" if text else ""


def listing(items: Sequence[str]) -> str:
    """Return a list; nothing without items."""
    return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>" if items else ""


def figure(data_uri: str, caption: str) -> str:
    """Return a picture with its caption, which is also its alternative text; a click enlarges it.

    The click ticks a hidden box, so that neither a script nor a second copy of the picture is needed.
    """
    text = escape(caption)
    image = f'<label><input type="checkbox" aria-label="enlarge"><img src="{data_uri}" alt="{text}"></label>'
    return f"<figure>{image}<figcaption>{text}</figcaption></figure>"


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: Sequence[int] = ()) -> str:
    """Return a table; the columns in `numbers` are aligned to the right.

    On a phone a table of more than five columns is a list: each row has a cell a line, after its column's name.
    """
    if not rows:
        return ""
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in header)
    names = [f' data-of="{escape(name)}"' if name else "" for name in header]
    kinds = [' class="number"' if column in numbers else "" for column in range(len(header))]
    cells = [
        [f"<td{k}{n}>{escape(cell)}</td>" for k, n, cell in zip(kinds, names, row, strict=True)] for row in rows
    ]
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in cells)
    wide = ' class="wide"' if len(header) > NARROW else ""
    return f'<div class="table"><table{wide}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
