"""Text of files prints as one line: breaks, escapes and changes of direction are spelt out, or refused."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest
from each import each

from calibration.report.page import listing
from tactilevision.errors import InputError, NothingCertified, RecordingError, one_line
from tactilevision.files.documents import parse_json, parse_toml
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recording
from tactilevision.records.rig import Sensor

FORGED = "topic\nwarning: all is well"
STEERING = [
    "\n",
    "\r",
    "\x1b[2J",
    "\x07",
    "\x85",
    "\u2028",
    "\u2029",
    "\u202e",
    "\u2066",
    "\u200f",
    "\ud800",
    "\x00",
]
HARMLESS = ["a\tb", "ν = .48 µm", "汉字 🤖", "a\\nb"]


@each("mark", STEERING)
def test_no_message_holds_a_mark_that_steers(mark: str) -> None:
    text = f"a{mark}b"
    said = [
        str(InputError(text, where=text, value=text, remedy=text)),
        str(RecordingError(f"column {text} is missing", where=Path(text.replace("\0", "")))),
        str(NothingCertified(f"no press can be trusted ({text})")),
        Recording(Path(), "x", Sensor("custom", 0, 0, (1.0, 1.0)), warnings=(text,)).warnings[0],
        listing([text]),
    ]
    assert not [one for one in said if mark in one]
    assert str(pickle.loads(pickle.dumps(InputError(text, where=text)))) == str(InputError(text, where=text))  # noqa: S301


@each("text", HARMLESS)
def test_other_text_stays_as_it_is(text: str) -> None:
    assert one_line(text) == text
    assert str(InputError(text)) == f"{text}."


def test_a_column_whose_name_forges_a_warning_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "recording.toml").write_text("format = 1\n[indenter.A]\nradius_mm = 1.0\n")
    (tmp_path / "points.csv").write_text(f'press,indenter,depth_mm,fz_N,"{FORGED}"\na,A,.1,1,2\n')
    with pytest.raises(RecordingError, match="the name of a column holds a control character") as refused:
        read_recording(tmp_path)
    assert "\n" not in str(refused.value)


@each(
    "text",
    [
        'name = "a\\nwarning: b"',
        '[indenter."a\\nb"]\nradius_mm = 1',
        '[sensor]\nserial = "a\\u202eb"',
        '[log]\nframes = "/a\\u001b[2J"',
        '[[robot]]\n"a\\u0000" = 1',
    ],
)
def test_names_of_the_settings_are_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "recording.toml").write_text(f"format = 1\n{text}\n")
    (tmp_path / "points.csv").write_text("press,indenter,depth_mm,fz_N\na,A,.1,1\n")
    with pytest.raises(RecordingError, match="control character"):
        read_recording(tmp_path)
    assert parse_toml('notes = """two\nlines"""', where="x") == {"notes": "two\nlines"}


@each("text", ['{"name": "\\ud800"}', '{"a": [{"\\udc12x": 1}]}', '{"name": "\\ud83d"}'])
def test_half_a_letter_is_no_json(text: str) -> None:
    for form in (text, text.encode()):
        with pytest.raises(InputError, match="half of a letter"):
            parse_json(form, where="x")
    whole = {"name": "🤖"}
    assert parse_json(json.dumps(whole), where="x") == whole
