"""Certify recordings into points or curves for several commands, locally or on a cluster."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from tactilevision.cli import console

if TYPE_CHECKING:
    from calibration.inputs.observations import Measured
    from calibration.result.result import CalibrationResult
    from tactilevision.errors import TactilevisionError
    from tactilevision.heightmap.reconstructor import Reconstructor
    from tactilevision.press.certificate import Certificate
    from tactilevision.recording.model import Recording
    from tactilevision.records.certified import CertifiedPoint
    from tactilevision.records.measured import Estimate


# What several commands begin with: recordings turned into points or curves, by the vision side where needed.


@dataclass(frozen=True, slots=True)
class Taken:
    """A recording; where it has frames, its certificate and what turned them into heights."""

    recording: Recording
    certificate: Certificate | None
    reconstructor: Reconstructor | None = None

    @property
    def points(self) -> tuple[CertifiedPoint, ...]:
        """Certified just now, or as the recording brought them."""
        return self.recording.points if self.certificate is None else self.certificate.points

    @property
    def measured(self) -> Measured:
        """What a fit gets."""
        from calibration.inputs.observations import Measured

        curves = self.recording.curves if self.certificate is None else ()
        return Measured(self.recording, self.points, curves)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Of the recording, of its light and of the certificate: what was said while they were read."""
        return (*self.recording.warnings, *(self.certificate.warnings if self.certificate else ()))


def oldest_first(paths: Sequence[Path]) -> list[Recording]:
    """The recordings by their dates."""
    from tactilevision.recording.read import read_recording

    return sorted((read_recording(path) for path in paths), key=lambda one: str(one.date or ""))


def take(paths: Sequence[Path], *, answered: str = "") -> list[Taken]:
    """Read recordings, the oldest first, and certify those that have frames.

    `answered`: words of a warning that is not said, since the command answers what it asks.
    """
    from tactilevision.recording.model import require

    opened = oldest_first(paths)
    for recording in opened:
        console.warn(recording.warnings)
        if not (recording.curves or recording.points):
            require(recording, "frames", step="certifying depths")
    return [_certified(one, answered) if one.frame_names else Taken(one, None) for one in opened]


def beside_the_punch(taken: Taken) -> tuple[Taken, Estimate | None]:
    """Poisson's ratio from the rise beside the punch, and the depths corrected by it where no better is stated."""
    from tactilevision.press.poisson_from_rise import with_nu

    if taken.certificate is None or taken.reconstructor is None:
        return taken, None
    with console.progress_bar("reading the gel beside the punch"):
        certificate, found = with_nu(taken.recording, taken.reconstructor, certificate=taken.certificate)
    console.warn(certificate.warnings[len(taken.certificate.warnings) :])
    return replace(taken, certificate=certificate), found


def with_what_was_read(
    result: CalibrationResult, taken: Sequence[Taken], *, answered: str = ""
) -> CalibrationResult:
    """The result with the warnings and flags of what it was fitted to, before its own."""
    said = tuple(line for one in taken for line in _unanswered(one.warnings, answered))
    flags = tuple(flag for one in taken if one.certificate for flag in one.certificate.flags)
    return replace(
        result,
        warnings=tuple(dict.fromkeys((*said, *result.warnings))),
        flags=tuple(dict.fromkeys((*result.flags, *flags))),
    )


def _certified(recording: Recording, answered: str) -> Taken:
    from tactilevision.heightmap.build import build_reconstructor
    from tactilevision.press.certification import certify, require_all

    require_all(recording)
    with console.progress_bar("calibrating the light"):
        reconstructor = build_reconstructor(recording, "polynomial" if recording.balls else None)
    console.warn(_unanswered(reconstructor.warnings, answered))
    with console.progress_bar("certifying presses") as progress:
        certificate = certify(recording, reconstructor, progress=progress)
    console.warn(_unanswered(certificate.warnings, answered))
    told = (*reconstructor.warnings, *certificate.warnings)
    return Taken(recording, replace(certificate, warnings=told), reconstructor)


def _unanswered(lines: Sequence[str], answered: str) -> list[str]:
    """The lines that do not ask what the command itself answers."""
    return [line for line in lines if not answered or answered not in line]


# Each recording as a task of its own on a Dask cluster: what comes of it and its warnings travel back.

T = TypeVar("T")
MARK = "warning: "  # how console.warn begins a line


def each_on_cluster(
    act: Callable[..., T], given: Sequence[Recording], *told: Any, cluster: str, title: str
) -> list[T]:
    """`act(path, *told)` of each recording, in their order; what it warns of is said here, what it raises raised.

    It writes nothing, so a task that is lost is done again. Raises ClusterError as `cluster_pool` does.
    """
    from tactilevision.cluster.pool import cluster_pool
    from tactilevision.errors import TactilevisionError

    with cluster_pool(cluster) as pool, console.progress_bar(title) as progress:
        tasks = [pool.submit(_listened, act, one.path.absolute(), *told) for one in given]
        found: list[T] = []
        for task in tasks:
            outcome, warnings = task.result()
            console.warn(warnings)
            if isinstance(outcome, TactilevisionError):
                raise outcome
            found.append(outcome)
            progress(len(found), len(given))
    return found


def _listened(act: Callable[..., T], *given: Any) -> tuple[T | TactilevisionError, list[str]]:
    """What came of it, or why nothing did, and its warnings."""
    from tactilevision.errors import TactilevisionError

    outcome: T | TactilevisionError
    with redirect_stderr(io.StringIO()) as said:
        try:
            outcome = act(*given)
        except TactilevisionError as fault:
            outcome = fault
    return outcome, [line.removeprefix(MARK) for line in said.getvalue().splitlines() if line.startswith(MARK)]
