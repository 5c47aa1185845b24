"""Calibrate on ball presses with a local page: their circles (the table ball.csv), the fit and its check."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.files.opening import number, real_path
from tactilevision.heightmap.ball_validation import RIM, dent_mm, unfit_warnings
from tactilevision.heightmap.poisson import integrate
from tactilevision.local_page import Answer, LocalPage, page_files
from tactilevision.photometric.ball_detection import Ball, Circle
from tactilevision.photometric.ball_pictures import BallPicture, locate
from tactilevision.photometric.ball_samples import ball_samples
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls, direction_error_deg
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.reference import make_reference
from tactilevision.recording import layout
from tactilevision.recording.ball_folder import TABLE, is_gs_sdk_folder, place_of_balls, read_catalogue
from tactilevision.recording.model import BallPress, Recording, faults_of_flats
from tactilevision.recording.pictures import list_images, read_flats, read_reference
from tactilevision.recording.tables import read_table
from tactilevision.recording.write import write_table
from tactilevision.records.constants import MICRO, TINY
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bytes, Floats, Pair, Picture
from tactilevision.sensors import may_have_marks
from tactilevision.sensors.rectification import rectify

# Circles of ball presses.

MIN_RADIUS_PX = 1.0  # px; a smaller circle is an error
State = Literal["found", "not found", "drawn", "checked", "excluded"]


@dataclass(frozen=True, slots=True)
class Label:
    """One press: its name in the table, its picture, the ball's radius, and its circle.

    `state`: "found" automatically, "drawn" by hand, "checked" by a person, or "excluded" (excluded from the
    table); `why` is the reason where no circle was found.
    """

    frame: str
    path: Path
    radius_mm: float
    circle: Circle | None = None
    state: State = "not found"
    why: str = ""

    @property
    def used(self) -> bool:
        """Return whether the fit uses the press."""
        return self.circle is not None and self.state != "excluded"


def labels_of(recording: Recording) -> tuple[Label, ...]:
    """Return the presses of the table and, excluded, the pictures of the folder that it does not list.

    Raises InputError where there are no presses.
    """
    if not recording.balls:
        remedy = "Put pictures of them into reference/ball, and state --ball-radius-mm."
        raise InputError("no ball presses to label", where=recording.path, remedy=remedy)
    listed = [_label(ball) for ball in recording.balls]
    radius_mm = float(np.median([label.radius_mm for label in listed]))
    names = {label.frame for label in listed}
    others = [ball for ball in _unlisted(recording, radius_mm) if ball.name not in names]
    return (*listed, *(Label(b.name, b.path, b.ball_radius_mm, state="excluded") for b in others))


def start_table(root: Path, radius_mm: float | None) -> None:
    """Write a table of all pictures with one radius, for a recording whose ball presses have none."""
    folder, table = _place(root)
    names = list_images(folder)
    if radius_mm is not None and names and not table.exists() and (root / layout.SETTINGS).is_file():
        write_table(table, {"frame": names, "ball_radius_mm": [radius_mm] * len(names)})


def write_labels(table: Path, labels: Sequence[Label]) -> None:
    """Write the presses that are not excluded, and the circles that a person drew or checked.

    Further columns of the table are kept.
    """
    kept = [label for label in labels if label.state != "excluded"]
    nowhere = (math.nan, math.nan, math.nan)
    said = [label.circle or nowhere if label.state in ("drawn", "checked") else nowhere for label in kept]
    columns: dict[str, list[Any]] = {
        "frame": [label.frame for label in kept],
        "ball_radius_mm": [label.radius_mm for label in kept],
        **{name: [c[n] for c in said] for n, name in enumerate(layout.BALL_COLUMNS.maybe_numbers)},
    }
    write_table(table, columns | _further(table, kept))


def _further(table: Path, labels: Sequence[Label]) -> dict[str, list[Any]]:
    """Return the cells of further columns of the existing table."""
    if not table.is_file():
        return {}
    old = read_table(table, layout.BALL_COLUMNS)
    row = {name: number for number, name in enumerate(old.words["frame"])}
    return {
        name: [cells[row[one.frame]] if one.frame in row else "" for one in labels]
        for name, cells in old.extra.items()
    }


def _label(ball: BallPress) -> Label:
    if ball.centre_px is None or ball.contact_radius_px is None:
        return Label(ball.name, ball.path, ball.ball_radius_mm)
    circle = (*ball.centre_px, ball.contact_radius_px)
    return Label(ball.name, ball.path, ball.ball_radius_mm, circle, "checked")


def _unlisted(recording: Recording, radius_mm: float) -> Sequence[BallPress]:
    root = recording.path
    if is_gs_sdk_folder(root):
        return read_catalogue(root)[0]
    folder, flats = _place(root)[0], {real_path(flat) for flat in recording.flats}
    paths = [folder / name for name in list_images(folder)]
    return [BallPress(path, radius_mm) for path in paths if real_path(path) not in flats]


def _place(root: Path) -> tuple[Path, Path]:
    """Return the folder of presses and their table."""
    if (root / layout.SETTINGS).is_file():
        return root / layout.BALLS, root / layout.BALL_TABLE
    if is_gs_sdk_folder(root):
        return root, root / TABLE
    return place_of_balls(root) or (root, root / TABLE)


# Each press by the law fitted without it: direction, depth, and a section through the ball.

SAMPLES = 500  # pixels of each ball, as for the scatter of the depth scale
REACH = 2.2  # contact radii that a section shows to either side


@dataclass(frozen=True, slots=True, eq=False)
class PressOutcome:
    """One press by the law fitted without it.

    `ball` with the circle of the fit; `direction_deg` median error of direction; `depth_ratio` read over true;
    `depth_mm` (H, W).
    """

    ball: Ball
    direction_deg: float
    depth_ratio: float
    depth_mm: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A calibration, and each press that it used by its name."""

    calibration: Calibration
    presses: dict[str, PressOutcome]
    mm_per_px: Pair

    def to_json(self) -> dict[str, Any]:
        """Return what the page shows."""
        found = list(self.presses.values())
        ratio = float(np.median([one.depth_ratio for one in found])) if found else math.nan
        method = self.calibration.method
        card = replace(method.card, other={**method.card.other, "held_out_depth_ratio": ratio})
        return {
            "method": method.name,
            "balls": len(found),
            "direction_deg": round(self.calibration.direction_error_deg, 2),
            "depth_ratio": _number(ratio),
            "unfit": list(unfit_warnings(card)),
            "warnings": list(self.calibration.warnings),
            "presses": {name: _press_json(one) for name, one in self.presses.items()},
        }

    def section(self, one: PressOutcome) -> dict[str, Any]:
        """Return depth along x through a ball's middle, and the ball's own, in mm; zero at the contact's rim."""
        (x, y), radius = one.ball.centre_px, one.ball.contact_radius_px
        height, width = one.depth_mm.shape
        row = int(np.clip(round(y), 0, height - 1))
        columns = np.arange(max(0, math.ceil(x - REACH * radius)), min(width, int(x + REACH * radius) + 1))
        along_mm = (columns - x) * self.mm_per_px[0]
        read = one.depth_mm[row, columns]
        share = np.abs(along_mm) / (radius * self.mm_per_px[0])
        rim = (share > RIM[0]) & (share < RIM[1])
        cap = np.sqrt(np.maximum(one.ball.radius_mm**2 - along_mm**2, 0.0))
        zero = (read[rim].mean(), cap[rim].mean()) if rim.any() else (read.max(), cap.max())
        return {
            "x_mm": np.round(along_mm, 4).tolist(),
            "read_mm": [_number(v) for v in read - zero[0]],
            "ball_mm": [_number(v) for v in np.where(share <= 1.0, cap - zero[1], np.nan)],
        }


def judge(calibration: Calibration, pictures: list[BallPicture], mm_per_px: Pair) -> Outcome:
    """Evaluate each press that a calibration used by the law fitted without it."""
    method, found, rng = calibration.method, dict[str, PressOutcome](), np.random.default_rng(0)
    rows = zip(pictures, calibration.balls, calibration.held_out_laws, strict=True)
    for index, (picture, ball, held_out) in enumerate(rows):
        if ball is None or held_out is None:
            continue
        other = replace(method, law=held_out.law, card=MethodCard())
        change, _, valid = other.change.measure_known(picture.rgb)
        seen = ball_samples(
            change, ball, mm_per_px=mm_per_px, number=index, most=SAMPLES, valid=valid, rng=rng
        ).complete()
        off = direction_error_deg(held_out.law.at(seen.change, seen.place), seen.slopes)
        slopes = other.slopes(picture.rgb)
        depth = integrate(SlopeMap(slopes.dz_dx, slopes.dz_dy), mm_per_px)
        read, true = dent_mm(depth, ball, mm_per_px=mm_per_px)
        median = float(np.median(off)) if len(off) else math.nan
        found[picture.name] = PressOutcome(ball, median, read / true, np.asarray(depth, np.float64))
    return Outcome(calibration, found, mm_per_px)


def _press_json(one: PressOutcome) -> dict[str, Any]:
    (x, y), radius = one.ball.centre_px, one.ball.contact_radius_px
    return {
        "circle": [round(x, 2), round(y, 2), round(radius, 2)],
        "residual": round(one.ball.residual, 3),
        "direction_deg": _number(one.direction_deg),
        "depth_ratio": _number(one.depth_ratio),
    }


def _number(value: float) -> float | None:
    return round(float(value), 4) if math.isfinite(value) else None


# Pictures of a press for the page.

MIDDLE_GREY = 128  # of the change's picture: no change
FULL_PERCENTILE = 99.5  # percentile of the change that is drawn in full colour


def encode(rgb: Bytes) -> bytes:
    """Return a picture (H, W, 3) of grey levels, red first, as PNG."""
    return cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1].tobytes()


def draw_change(change: Picture) -> Bytes:
    """Return a relative change (3, H, W) as colours round grey (H, W, 3), grey levels; unknown is grey."""
    known = np.nan_to_num(np.asarray(change, np.float32))
    full = max(float(np.percentile(np.abs(known), FULL_PERCENTILE)), MICRO)
    level = MIDDLE_GREY + (MIDDLE_GREY - 1) * np.clip(known / full, -1.0, 1.0)
    return np.ascontiguousarray(level.transpose(1, 2, 0)).astype(np.uint8)


def draw_depth(depth_mm: Floats) -> Bytes:
    """Return depth (H, W) in mm as colours (H, W, 3) of grey levels, from 0 (dark) to the deepest (bright)."""
    top = max(float(np.nanmax(depth_mm)), TINY)
    level = np.asarray(255 * np.clip(np.nan_to_num(depth_mm) / top, 0.0, 1.0), np.uint8)
    return np.asarray(cv2.cvtColor(cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB), np.uint8)


# The guide and its page.

VIEWS = ("picture", "change", "depth")
SETTABLE = ("drawn", "checked", "excluded")


class Session:
    """Labels of one recording while a person edits them. Thread-safe."""

    def __init__(self, recording: Recording, *, method: str = "polynomial") -> None:
        self.recording, self.sensor, self.fit_by = recording, recording.sensor, PHOTOMETRIC[method]
        self.table = _place(recording.path)[1]
        self.labels = list(labels_of(recording))
        flats = [rectify(self.sensor, rgb) for rgb in read_flats(recording)]
        with faults_of_flats(recording):
            reference = make_reference(flats, may_have_marks=may_have_marks(self.sensor))
        self.reference, self.change = reference, ColourChange(reference)
        self.pictures = [rectify(self.sensor, read_reference(recording, label.path)) for label in self.labels]
        self.outcome: Outcome | None = None
        self._lock, self._fitting = threading.Lock(), threading.Lock()
        for index, label in enumerate(self.labels):
            if label.circle is None and label.state != "excluded":
                self.labels[index] = self._found(index, label)

    def to_json(self) -> dict[str, Any]:
        """Return all presses, and the sensor's size and scale."""
        height, width = self.reference.shape
        return {
            "name": self.recording.name,
            "table": str(self.table),
            "size": [width, height],
            "mm_per_px": list(self.sensor.mm_per_px),
            "presses": [_label_json(label) for label in self.labels],
        }

    def set(self, index: int, asked: dict[str, Any]) -> dict[str, Any]:
        """Set a press's circle [x, y, radius] in px and its state. Raises InputError where they are invalid."""
        circle, state = _circle(asked.get("circle"), self.reference.shape), asked.get("state")
        if state not in SETTABLE or (circle is None and state != "excluded"):
            raise InputError("a press needs a circle, or must be excluded", where="the page", value=state)
        with self._lock:
            label = self.labels[index]
            self.labels[index] = replace(label, circle=circle or label.circle, state=state, why="")
            return _label_json(self.labels[index])

    def find(self, index: int, asked: dict[str, Any]) -> dict[str, Any]:
        """Search for a ball, from a circle if one is given; the press is unchanged where none is found."""
        start = replace(self.labels[index], circle=_circle(asked.get("circle"), self.reference.shape))
        with self._lock:
            found = self._found(index, start)
            if found.circle is not None or self.labels[index].circle is None:
                self.labels[index] = found
            return {**_label_json(self.labels[index]), "why": found.why}

    def fit(self) -> dict[str, Any]:
        """Calibrate the light on the circles, and evaluate it on held-out balls."""
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
        """Return the section through a press by the last fit; empty where that did not use it."""
        outcome, one = self.outcome, self._judged(index)
        return {} if outcome is None or one is None else outcome.section(one)

    def view(self, index: int, kind: str) -> bytes | None:
        """Return a press as PNG: "picture", "change" or "depth"; None where the last fit has no depth of it."""
        if kind == "picture":
            return encode(self.pictures[index])
        if kind == "change":
            with self._lock:
                return encode(draw_change(self.change.measure_known(self.pictures[index])[0]))
        one = self._judged(index)
        return None if one is None else encode(draw_depth(one.depth_mm))

    def _judged(self, index: int) -> PressOutcome | None:
        """Return a press by the last fit."""
        return None if self.outcome is None else self.outcome.presses.get(self.labels[index].frame)

    def _found(self, index: int, label: Label) -> Label:
        picture = _ball_picture(label, self.pictures[index])
        try:
            changes, _, valid = self.change.measure_known(picture.rgb)
            ball = locate(changes, valid, picture=picture, mm_per_px=self.sensor.mm_per_px)
        except (InputError, np.linalg.LinAlgError) as fault:
            why = fault.what if isinstance(fault, InputError) else "the fit of the circle fails"
            return replace(label, circle=None, state="not found", why=why)
        return replace(label, circle=(*ball.centre_px, ball.contact_radius_px), state="found", why="")


def _ball_picture(label: Label, rgb: Bytes) -> BallPicture:
    centre, radius = (label.circle[:2], label.circle[2]) if label.circle else (None, None)
    return BallPicture(rgb, label.radius_mm, centre, radius, label.frame)


def _circle(asked: object, shape: tuple[int, int]) -> Circle | None:
    if asked is None:
        return None
    cells = asked if isinstance(asked, list) and len(asked) == 3 else [None] * 3
    x, y, radius = (number(cell, what="a circle's number", where="the page") for cell in cells)
    if x is None or y is None or radius is None or not MIN_RADIUS_PX <= radius <= max(shape):
        raise InputError("a circle is x, y and radius in px", where="the page", value=asked)
    return x, y, radius


def _label_json(label: Label) -> dict[str, Any]:
    return {
        "frame": label.frame,
        "radius_mm": label.radius_mm,
        "circle": None if label.circle is None else [round(value, 2) for value in label.circle],
        "state": label.state,
        "why": label.why,
    }


class Guide(LocalPage):
    """The page while it is open. `wait` returns when the person has finished."""

    def __init__(self, session: Session, *, port: int = 0) -> None:
        self.session, self.done = session, threading.Event()
        super().__init__(page_files(Path(__file__).parent / "page"), port=port)

    def wait(self) -> None:
        """Wait until the page reports the end; Ctrl-C ends it, too."""
        while not self.done.wait(0.5):
            pass

    def get(self, name: str, asked: Mapping[str, str]) -> Answer | dict[str, Any] | None:
        """Return the presses, a picture or a section."""
        if name == "presses":
            return self.session.to_json()
        kind_of_view, _, at = name.partition("/")
        if kind_of_view == "section":
            return self.session.section(self._index(at))
        view = self.session.view(self._index(at), kind_of_view) if kind_of_view in VIEWS else None
        return None if view is None else Answer("image/png", view)

    def post(self, name: str, content: dict[str, Any]) -> dict[str, Any] | None:
        """Set or find a circle, fit, save the table, or end."""
        what, _, at = name.partition("/")
        if what in ("set", "find"):
            act = self.session.set if what == "set" else self.session.find
            return act(self._index(at), content)
        if name == "fit":
            return self.session.fit()
        if name not in ("save", "done"):
            return None
        kept = self.session.save()
        if name == "done":
            self.done.set()
        return kept

    def _index(self, at: str) -> int:
        if not (at.isascii() and at.isdigit() and len(at) < 7 and int(at) < len(self.session.labels)):
            raise InputError("no press of that number", where="the page", value=at[:20])
        return int(at)
