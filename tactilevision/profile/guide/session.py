"""What the page of the guide asks: presses and their circles, the finder, the fit, the table."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np

from tactilevision.door.numbers import number
from tactilevision.errors import InputError
from tactilevision.photometric import PHOTOMETRIC, BallPicture, calibrate_from_balls, make_reference
from tactilevision.photometric.found_balls import locate
from tactilevision.photometric.illumination.colour_change import ColourChange
from tactilevision.profile.guide.labels import MIN_RADIUS_PX, Circle, Label, labels_of, table_of, write_labels
from tactilevision.profile.guide.outcome import Outcome, judge
from tactilevision.profile.guide.pictures import draw_change, draw_depth, encode
from tactilevision.recording import Recording, faults_of_flats, read_flats, read_reference
from tactilevision.records import Bytes
from tactilevision.sensors import may_have_marks, rectify

VIEWS = ("picture", "change", "depth")
SETTABLE = ("drawn", "checked", "left out")


class Session:
    """Labels of one recording while a person works on them. Safe to ask from several threads."""

    def __init__(self, recording: Recording, *, method: str = "polynomial") -> None:
        self.recording, self.sensor, self.fit_by = recording, recording.sensor, PHOTOMETRIC[method]
        self.table = table_of(recording)
        self.labels = list(labels_of(recording))
        flats = [rectify(self.sensor, rgb) for rgb in read_flats(recording)]
        with faults_of_flats(recording):
            reference = make_reference(flats, may_have_marks=may_have_marks(self.sensor))
        self.reference, self.change = reference, ColourChange(reference)
        self.pictures = [self._read(label) for label in self.labels]
        self.outcome: Outcome | None = None
        self._lock, self._fitting = threading.Lock(), threading.Lock()
        for index, label in enumerate(self.labels):
            if label.circle is None and label.state != "left out":
                self.labels[index] = self._found(index, label)

    def to_json(self) -> dict[str, Any]:
        """All presses, and what a page has to know of the sensor."""
        height, width = self.reference.shape
        return {
            "name": self.recording.name,
            "table": str(self.table),
            "size": [width, height],
            "mm_per_px": list(self.sensor.mm_per_px),
            "presses": [_told(label) for label in self.labels],
        }

    def set(self, index: int, asked: dict[str, Any]) -> dict[str, Any]:
        """Take a press's circle [x, y, radius] in px and its state. Raises InputError where they are none."""
        circle, state = _circle(asked.get("circle"), self.reference.shape), asked.get("state")
        if state not in SETTABLE or (circle is None and state != "left out"):
            raise InputError("a press has a circle, or is left out", where="the page", value=state)
        with self._lock:
            label = self.labels[index]
            self.labels[index] = replace(label, circle=circle or label.circle, state=state, why="")
            return _told(self.labels[index])

    def find(self, index: int, asked: dict[str, Any]) -> dict[str, Any]:
        """Look for a ball, from a circle if one is given; the press is as it was where none is found."""
        start = replace(self.labels[index], circle=_circle(asked.get("circle"), self.reference.shape))
        with self._lock:
            found = self._found(index, start)
            if found.circle is not None or self.labels[index].circle is None:
                self.labels[index] = found
            return {**_told(self.labels[index]), "why": found.why}

    def fit(self) -> dict[str, Any]:
        """Calibrate the light on the circles as they are, and judge it by balls left out."""
        with self._fitting:
            with self._lock:
                rows = [(label, rgb) for label, rgb in zip(self.labels, self.pictures, strict=True) if label.used]
            balls = [_ball_picture(label, rgb) for label, rgb in rows]
            try:
                made = calibrate_from_balls(
                    self.reference, balls, mm_per_px=self.sensor.mm_per_px, fit=self.fit_by
                )
            except InputError as fault:
                self.outcome = None
                return {"fault": str(fault)}
            self.outcome = judge(made, balls, self.sensor.mm_per_px)
            return self.outcome.to_json()

    def save(self) -> dict[str, Any]:
        """Write the table."""
        with self._lock:
            write_labels(self.table, self.labels)
            return {"table": str(self.table)}

    def section(self, index: int) -> dict[str, Any]:
        """The section through a press by the last fit; empty where that did not use it."""
        outcome, name = self.outcome, self.labels[index].frame
        return outcome.section(name) if outcome is not None and name in outcome.presses else {}

    def view(self, index: int, kind: str) -> bytes | None:
        """A press as PNG: "picture", "change", or "depth"; None where the last fit has no depth of it."""
        if kind == "picture":
            return encode(self.pictures[index])
        if kind == "change":
            with self._lock:
                return encode(draw_change(self.change.measure_known(self.pictures[index])[0]))
        outcome, name = self.outcome, self.labels[index].frame
        if outcome is None or name not in outcome.presses:
            return None
        return encode(draw_depth(outcome.presses[name].depth_mm))

    def _read(self, label: Label) -> Bytes:
        return rectify(self.sensor, read_reference(self.recording, label.path))

    def _found(self, index: int, label: Label) -> Label:
        picture = _ball_picture(label, self.pictures[index])
        try:
            changes, _, valid = self.change.measure_known(picture.rgb)
            ball = locate(changes, valid, picture=picture, mm_per_px=self.sensor.mm_per_px)
        except (InputError, np.linalg.LinAlgError) as fault:
            why = fault.what if isinstance(fault, InputError) else "the fit of the circle fails there"
            return replace(label, circle=None, state="not found", why=why)
        return replace(label, circle=(*ball.centre_px, ball.contact_radius_px), state="found", why="")


def _ball_picture(label: Label, rgb: Bytes) -> BallPicture:
    x, y, radius = label.circle or (0.0, 0.0, 0.0)
    known = label.circle is not None
    return BallPicture(rgb, label.radius_mm, (x, y) if known else None, radius if known else None, label.frame)


def _circle(asked: object, shape: tuple[int, int]) -> Circle | None:
    if asked is None:
        return None
    cells = asked if isinstance(asked, list) and len(asked) == 3 else [None] * 3
    x, y, radius = (number(cell, what="a circle's number", where="the page") for cell in cells)
    if x is None or y is None or radius is None or not MIN_RADIUS_PX <= radius <= max(shape):
        raise InputError("a circle is x, y and radius in px", where="the page", value=asked)
    return x, y, radius


def _told(label: Label) -> dict[str, Any]:
    return {
        "frame": label.frame,
        "radius_mm": label.radius_mm,
        "circle": None if label.circle is None else [round(value, 2) for value in label.circle],
        "state": label.state,
        "why": label.why,
    }
