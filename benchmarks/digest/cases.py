"""The cases of the digest: which commands are run on which recording, and which of their results are kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np

from benchmarks.digest.values import Values, of_json, of_map, of_table
from benchmarks.digest.workspace import ROOT, SAMPLES, Workspace

BY_HEIGHT = "fall_"  # columns of points.csv that hold numbers in their names
BULKY = ("place_gain_std", "extrapolated_gain_std", "answers")
EVERY = 40  # pixels between those of a map that are kept
GELSLIM3 = SAMPLES / "gelslim3"
RIG = SAMPLES / "hidden_rig"
DATA = ROOT / "tests" / "data"
CERTIFIED = DATA / "calibration.json"  # of the sample gelslim3
UNBOUNDED = ('shape = "disc"', 'shape = "unbounded"')  # a gel without sides, whose force is quick to work out


@dataclass(frozen=True, slots=True)
class Case:
    """`values` of the commands of one case; `quick` ones run with the ordinary tests."""

    values: Callable[[Workspace], Values]
    quick: bool = False


def calibration(folder: Path, prefix: str = "calibration") -> Values:
    """E, nu, c, beta with their intervals, the presses taken and left, and each press' point."""
    found = of_json(folder / "calibration.json", prefix)
    if (folder / "points.csv").exists():
        found |= of_table(folder / "points.csv", f"{prefix}.points", skip=BY_HEIGHT)
    return found


def diagnosis(folder: Path) -> Values:
    """The verdict, the effects and their sizes, the candidates, the errors before and after, what to measure."""
    found = of_json(folder / "diagnosis.json", "diagnosis", skip=("youngs_modulus_of_nu", "covariance"))
    return found | of_json(folder / "history.json", "history")


def heights(folder: Path, prefix: str = "depth") -> Values:
    """The table of frames and every height map, with its standard deviation where that was asked for."""
    found = of_table(folder / "depth.csv", prefix, skip="ms$")
    for kind, name in (("depth", "height"), ("depth_std", "height_std")):
        for path in sorted((folder / kind).glob("*.tiff")):
            picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            if picture is None:
                raise ValueError(f"{path} is no picture")
            found |= of_map(np.asarray(picture), f"{prefix}.{name}.{path.stem}", EVERY)
    return found


def tractions(folder: Path, frames: Sequence[int], prefix: str = "force") -> Values:
    """Resultants of all frames, and maps of traction of some."""
    found = of_table(folder / "resultants.csv", prefix) | of_json(folder / "said.json", f"{prefix}.said")
    with np.load(folder / "tractions.npz", allow_pickle=False) as stacks:
        for name in sorted(stacks.files):
            if stacks[name].ndim == 3:
                for frame in frames:
                    found |= of_map(stacks[name][frame], f"{prefix}.{name}.{frame}", EVERY)
    return found


def _calibrate(recording: Path, *more: object) -> Callable[[Workspace], Values]:
    return lambda space: calibration(space.run("calibrate", recording, *more))


def _diagnose(recording: Path, *more: object) -> Callable[[Workspace], Values]:
    return lambda space: diagnosis(space.run("diagnose", recording, *more))


def _few_depths(space: Workspace) -> Values:
    few = space.thin(GELSLIM3, ("00010.jpg", "00100.jpg", "00300.jpg"))
    return heights(space.run("depth", few, "--workers", 1, "--pictures", 0, "--std"))


def _anchored_depths(space: Workspace) -> Values:
    """Height maps that are held to the faces of the presses' punches."""
    certified = space.run("calibrate", GELSLIM3) / "calibration.json"
    few = space.thin(GELSLIM3, tuple(f"{number:05d}.jpg" for number in range(8, 400, 49)))
    return heights(space.run("depth", few, "--workers", 1, "--pictures", 0, "--calibration", certified))


def _one_force(space: Workspace) -> Values:
    few = space.thin(RIG, ("00010.jpg",), UNBOUNDED)
    return tractions(space.run("force", few, "--workers", 1, "--pictures", 0, "--calibration", CERTIFIED), (0,))


def _forces_between_sides(space: Workspace) -> Values:
    """Tractions on a gel whose sides count."""
    few = space.thin(RIG, ("00010.jpg", "00100.jpg"))
    done = space.run("force", few, "--workers", 1, "--pictures", 0, "--calibration", CERTIFIED)
    return tractions(done, (0, 1))


def _saved_method(name: str) -> Callable[[Workspace], Values]:
    """Height maps by a method's file."""
    method = DATA / "methods" / f"{name}.npz"
    return lambda space: heights(
        space.run(
            *("depth", DATA / "small", "--workers", 1, "--pictures", 0, "--std", "--method", method, "--even-so")
        )
    )


def _train(recording: Path, method: str) -> Callable[[Workspace], Values]:
    return lambda space: of_json(
        space.run("train", recording, "--method", method) / "method.json", "card", skip=BULKY
    )


def _compare(space: Workspace) -> Values:
    return of_json(
        space.run("compare", SAMPLES / "hidden_material", "--with", "viscoelasticity") / "said.json", "comparison"
    )


def _validate(recording: Path) -> Callable[[Workspace], Values]:
    return lambda space: of_json(space.run("validate", recording) / "validation.json", "validation")


def _simulated_points(space: Workspace) -> Values:
    made = space.simulate("--seed", 11, "--frames", "points", "--youngs-modulus", 0.25, "--poisson-ratio", 0.47)
    paper = calibration(space.run("calibrate", made, "--law", "paper"), "paper")
    return calibration(space.run("calibrate", made)) | paper


def _simulated_pictures(*options: object) -> Callable[[Workspace], Values]:
    """Pictures from a seed, calibrated; three of them as heights."""

    def values(space: Workspace) -> Values:
        made = space.simulate("--presses", 1, *options)
        pictures = sorted(path.name for path in (made / "frames").iterdir())
        few = space.thin(made, tuple(pictures[number] for number in (10, 48, 86)))
        maps = heights(space.run("depth", few, "--workers", 1, "--pictures", 0))
        return calibration(space.run("calibrate", made)) | maps

    return values


def _drawn(*options: object, diagnosed: bool = True) -> Callable[[Workspace], Values]:
    """Curves from a seed with something hidden in them, calibrated and, where that is short, diagnosed."""

    def values(space: Workspace) -> Values:
        made = space.draw(*options)
        found = calibration(space.run("calibrate", made))
        return found | diagnosis(space.run("diagnose", made)) if diagnosed else found

    return values


CASES: Mapping[str, Case] = MappingProxyType({
    "calibrate paper_points": Case(_calibrate(SAMPLES / "paper_points"), quick=True),
    "calibrate paper_points, paper's law": Case(_calibrate(SAMPLES / "paper_points", "--law", "paper")),
    "calibrate gelslim3": Case(_calibrate(GELSLIM3)),
    "calibrate hidden_material": Case(_calibrate(SAMPLES / "hidden_material")),
    "calibrate hidden_unknown": Case(_calibrate(SAMPLES / "hidden_unknown")),
    "calibrate hidden_rig": Case(_calibrate(RIG)),
    "depth of three frames": Case(_few_depths),
    "depth held to the faces": Case(_anchored_depths),
    "force of one frame": Case(_one_force),
    "force between sides": Case(_forces_between_sides),
    "saved polynomial": Case(_saved_method("polynomial"), quick=True),
    "diagnose hidden_material": Case(_diagnose(SAMPLES / "hidden_material")),
    "diagnose hidden_rig": Case(_diagnose(RIG)),
    "diagnose hidden_unknown": Case(_diagnose(SAMPLES / "hidden_unknown")),
    "diagnose hidden_shadow": Case(_diagnose(SAMPLES / "hidden_shadow")),
    "diagnose hidden_force": Case(_diagnose(SAMPLES / "hidden_force")),
    "compare hidden_material": Case(_compare),
    "validate paper_points": Case(_validate(SAMPLES / "paper_points")),
    "train polynomial": Case(_train(RIG, "polynomial")),
    "train lookup": Case(_train(RIG, "lookup")),
    "train auto": Case(_train(RIG, "auto")),
    "simulated points": Case(_simulated_points),
    "simulated pictures": Case(_simulated_pictures("--seed", 13, "--frames", "jpeg", "--no-faults")),
    "simulated pictures with markers": Case(
        _simulated_pictures("--seed", 14, "--no-faults", "--markers", "--youngs-modulus", 0.12)
    ),
    "drawn, one punch, nothing hidden": Case(
        _drawn("--seed", 303, "--design", "plain", "--gel", "fem", "--noise", "ar1")
    ),
    "drawn, two punches, viscoelastic": Case(
        _drawn("--seed", 301, "--design", "medium", "--hidden", "viscoelasticity")
    ),
    "drawn, three punches, a rig that gives": Case(
        _drawn("--seed", 302, "--hidden", "backing_compliance", "--source", "stage", diagnosed=False)
    ),
})  # fmt: skip
