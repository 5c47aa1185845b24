"""The documents name what there is, and nothing that is gone."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
import typer
from each import each
from shared_scenes import calibrated_points

from tactilevision.cli.app import app

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
ARCHITECTURE = (DOCS / "explanation" / "architecture.md").read_text(encoding="utf-8")
GENERATED = ("_build", "gallery", "api")
PAGES = sorted(page for page in DOCS.rglob("*.md") if page.relative_to(DOCS).parts[0] not in GENERATED)
MANUAL = [page for page in (ROOT / "README.md", *PAGES) if "evidence" not in page.parts]
MAX_WORDS = 25  # of a sentence in the manual; the evidence is a record, not a manual


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def top_level() -> list[str]:
    """Files and packages at the top of both packages."""
    paths = [path for name in ("tactilevision", "calibration") for path in (ROOT / name).iterdir()]
    paths = [path for path in paths if path.name[0] not in "_."]
    files = [str(path.relative_to(ROOT)) for path in paths if path.suffix == ".py"]
    return sorted(files + [f"{path.relative_to(ROOT)}/" for path in paths if (path / "__init__.py").is_file()])


@each("place", top_level())
def test_the_architecture_shows_every_package(place: str) -> None:
    assert f"`{place}`" in ARCHITECTURE


@each("page", [ROOT / "README.md", *PAGES])
def test_every_file_that_a_page_names_exists(page: Path) -> None:
    tops = "tactilevision|calibration|benchmarks|tests|models|sample_frames|examples"
    named = set(re.findall(rf"`((?:{tops})/[\w/.]*)`", page.read_text(encoding="utf-8"))) - {
        "tactilevision/_models"
    }
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def prose(text: str) -> str:
    """A page without code, tables, headings and directives; each item of a list ends a sentence."""
    text = re.sub(r"^(```|:::)[\s\S]*?^\1", "\n\n", text, flags=re.MULTILINE)
    text = re.sub(r"^(#.*|\|.*|!\[.*|\(.*\)=|:.*|\$ .*)$", "", text, flags=re.MULTILINE)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return re.sub(r"^ *([-*]|\d+\.) ", "\n\n", text, flags=re.MULTILINE)


def sentences(text: str) -> list[str]:
    """Its sentences, each on one line."""
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n", prose(text))]
    parts = [re.split(r"(?<=[.!?])[*_)]*\s+", paragraph) for paragraph in paragraphs]
    return [sentence for part in parts for sentence in part if sentence]


@each("page", MANUAL)
def test_sentences_of_the_manual_are_short(page: Path) -> None:
    found = sentences(page.read_text(encoding="utf-8"))
    assert [said for said in found if len(re.findall(r"\w[\w'.,/-]*", said)) > MAX_WORDS] == []


def anchors(page: Path) -> set[str]:
    """The headings and labels of a page, as links name them."""
    text = page.read_text(encoding="utf-8")
    headings = re.findall(r"^#+ (.+)$", re.sub(r"```[\s\S]*?```", "", text), flags=re.MULTILINE)
    slugs = {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}
    return slugs | set(re.findall(r"^\((.+)\)=$", text, flags=re.MULTILINE))


@each("page", [ROOT / "README.md", *PAGES])
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```[\s\S]*?```", "", page.read_text(encoding="utf-8"))
    dead = []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        path, _, anchor = link.partition("#")
        if "://" in link or re.search(r"(gallery|api)/|^(tactilevision|calibration)\.rst", path):
            continue  # other sites; pages that a build writes, which check_links.py looks at
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            dead.append(link)
    assert dead == []


def test_the_site_check_finds_dead_links_and_anchors(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<p id="here"></p><a href="b.html#there"></a><a href="c.html"></a>')
    (tmp_path / "b.html").write_text('<a href="a.html#here"></a><a href="https://example.org"></a>')
    check = runpy.run_path(str(DOCS / "check_links.py"))
    assert check["dead_links"](tmp_path) == ["a.html -> b.html#there", "a.html -> c.html"]


@pytest.mark.parametrize("package", ["tactilevision", "calibration"])
def test_the_api_shows_every_public_name(package: str) -> None:
    shown = runpy.run_path(str(DOCS / "_ext" / "public_names.py"))["page"](package)
    for name in getattr(importlib.import_module(package), "__all__", ()):
        assert re.search(rf"^\.\. .*:: ({package}\.)?{name}$", shown, flags=re.MULTILINE), name


def test_docstrings_keep_their_equations_and_lose_no_character() -> None:
    as_rst = runpy.run_path(str(DOCS / "_ext" / "plain_docstrings.py"))["as_rst"]
    lines = as_rst(["A `name` and a*b*c.", "", "    P = c w", "    w > 0", "", "Then."])
    assert lines == [
        "A ``name`` and a\\*b\\*c.",
        "",
        "::",
        "",
        "        P = c w",
        "        w > 0",
        "",
        "Then.",
        "",
    ]


def test_the_glossary_is_in_order() -> None:
    text = (DOCS / "explanation" / "glossary.md").read_text(encoding="utf-8")
    words = re.findall(r"^(\w[^\n]*)\n  \S", text.split("```{glossary}")[1], flags=re.MULTILINE)
    assert words == sorted(words, key=str.lower)


def called(text: str) -> list[tuple[str, list[str]]]:
    """Each `tactilevision COMMAND ...` of a page's blocks and tables, with the options it gives."""
    blocks = "\n".join(re.findall(r"^```\n([\s\S]*?)^```", text, flags=re.MULTILINE))
    lines = re.findall(r"tactilevision ([a-z-]+)([^\n#]*)", blocks)
    lines += re.findall(r"`tactilevision ([a-z-]+)([^`\n]*)`", text)
    return [(command, re.findall(r"--[a-z-]+", rest)) for command, rest in lines]


GROUP = typer.main.get_command(app)
COMMANDS = {name: GROUP.get_command(None, name) for name in GROUP.list_commands(None)}  # type: ignore[attr-defined]


@each("page", [ROOT / "README.md", *PAGES])
def test_commands_and_options_of_the_pages_exist(page: Path) -> None:
    for command, options in called(page.read_text(encoding="utf-8")):
        assert command in COMMANDS, command
        known = {name for option in COMMANDS[command].params for name in option.opts}
        assert set(options) <= {*known, "--help"}, command


def calls(block: str) -> list[tuple[str, ast.Call]]:
    """Calls in a block of Python of names that it imports from tactilevision; none that unpacks arguments."""
    tree = ast.parse(block)
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module]
    known = {name.name: node.module for node in imports for name in node.names}
    found = [(node.func, node) for node in ast.walk(tree) if isinstance(node, ast.Call)]
    named = [(func.id, call) for func, call in found if isinstance(func, ast.Name) and func.id in known]
    plain = [one for one in named if not any(isinstance(given, ast.Starred) for given in one[1].args)]
    return [(f"{known[name]}:{name}", call) for name, call in plain]


@each("page", [ROOT / "README.md", *PAGES])
def test_calls_on_the_pages_fit_what_they_call(page: Path) -> None:
    for block in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S):
        for place, call in calls(block):
            module, _, name = place.partition(":")
            called_object = getattr(importlib.import_module(module), name)
            keywords = {keyword.arg: None for keyword in call.keywords if keyword.arg is not None}
            inspect.signature(called_object).bind(*[None] * len(call.args), **keywords)


def test_the_format_names_every_key_of_a_calibration() -> None:
    told = (ROOT / "docs" / "format.md").read_text(encoding="utf-8").split("## calibration.json")[1]
    content = json.loads((calibrated_points() / "calibration.json").read_text())
    missing = [key for key in content if f"`{key}`" not in told]
    assert missing == []


FILL = runpy.run_path(str(DOCS / "fill.py"))
NUMBERS: dict[str, list[Any]] = FILL["stated"]()
DIGEST = json.loads((ROOT / "tests" / "digest.json").read_text())["cases"]


@each("page", list(NUMBERS))
def test_a_page_has_its_numbers_where_they_are_stated(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    assert len(list(FILL["places"](text, NUMBERS[page]))) == len(NUMBERS[page])


def of_the_digest(number: Any) -> Any:
    """The value that the command gave when it was last recorded, if it was."""
    walk, _, file = number.file.partition("/")
    command = "diagnose" if file.startswith("diagnosis") else "compare"
    kept = DIGEST.get(f"{command} {walk}", {})
    name = f"{file.rpartition('/')[2]}.{number.key}"
    listed, _, at = name.rpartition(".")
    if at.isdigit() and listed in kept:
        return float(kept[listed][int(at)])
    return kept.get(name)


def test_numbers_of_the_pages_are_those_of_the_digest() -> None:
    known = [(one, of_the_digest(one)) for page in NUMBERS.values() for one in page]
    compared = [(one.text, one.filled(lambda *_, v=value: v).text) for one, value in known if value is not None]
    assert len(compared) > len(known) / 2
    assert [(stands, is_now) for stands, is_now in compared if stands != is_now] == []
