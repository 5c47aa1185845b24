"""One call from a recording's folder to E and nu, one to a diagnosis: certification joined with `calibration`.

A recording with frames is certified first: the light is calibrated on its ball presses, each press gets a
certified depth and force, and Poisson's ratio is estimated from the rise of the gel outside the contact. A
recording that brings points or curves of depth and force is taken as it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from calibration.diagnosis.diagnosis import Diagnosis
from calibration.inputs.arrays import measured_of, samples_of
from calibration.inputs.deadline import NEVER, SILENT, Deadline, Progress, Watch
from calibration.inputs.gather import observe_curves
from calibration.inputs.observations import Measured, Observations, leave_out
from calibration.model.stages import Effect, Law
from calibration.result.result import CalibrationResult, unfixed_as_json
from calibration.tasks.calibrate import calibrate, observe
from calibration.tasks.compare import Comparison, compare
from calibration.tasks.diagnose import diagnose
from tactilevision.cluster.pool import cluster_pool, step_pool
from tactilevision.errors import InputError, NothingCertified, TactilevisionError
from tactilevision.files.cache import kept_record
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.press.certificate import Certificate, event_map
from tactilevision.press.certification import certify
from tactilevision.press.poisson_from_rise import with_nu
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import content_of
from tactilevision.recording.read import Source, oldest_first, read_recordings
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.constants import NU_SILICONE
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Estimate

if TYPE_CHECKING:
    from calibration.report.drawing import ResidualMap
    from calibration.tasks.validate import Validation

Given: TypeAlias = "Source | CertifiedRecording"
DEFAULT_LAW = "default"  # the only law that uses Poisson's ratio from the rise


class Listener(Protocol):
    """Receives progress and warnings as soon as they arise; `tactilevision.cli.console` is one."""

    def progress_bar(self, title: str) -> AbstractContextManager[Progress]:
        """Begin a step that takes time."""

    def warn(self, lines: Sequence[str]) -> None:
        """Receive warnings, which the result also holds."""


@dataclass(frozen=True, slots=True)
class Collected:
    """A listener that keeps the warnings and shows nothing."""

    warnings: list[str] = field(default_factory=list)

    def progress_bar(self, title: str) -> AbstractContextManager[Progress]:
        """Begin a step without showing it."""
        return nullcontext(SILENT)

    def warn(self, lines: Sequence[str]) -> None:
        """Keep the warnings."""
        self.warnings.extend(lines)


@dataclass(frozen=True, slots=True)
class CertifiedRecording:
    """A recording; where it has frames, its certificate, what turned them into heights, and nu from the rise."""

    recording: Recording
    certificate: Certificate | None = None
    reconstructor: Reconstructor | None = None
    poisson_ratio: Estimate | None = None

    @property
    def points(self) -> tuple[CertifiedPoint, ...]:
        """The points of the certificate, or those that the recording brought."""
        return self.recording.points if self.certificate is None else self.certificate.points

    @property
    def measured(self) -> Measured:
        """The measurements as `calibration` takes them."""
        curves = self.recording.curves if self.certificate is None else ()
        return Measured(self.recording, self.points, curves)

    @property
    def clock_offset(self) -> Estimate | None:
        """Force/torque clock minus camera clock, s; None without frames."""
        return self.certificate.clock_offset if self.certificate else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the recording, of its light and of its certificate."""
        return (*self.recording.warnings, *(self.certificate.warnings if self.certificate else ()))


@dataclass(frozen=True, slots=True)
class Calibrated:
    """Outcome of one recording: content of calibration.json; `result` is None where `fault` says why."""

    certified: CertifiedRecording
    content: dict[str, Any]
    result: CalibrationResult | None = None
    fault: TactilevisionError | None = None


def calibrate_recording(
    recording: Given,
    *,
    law: Law | str = DEFAULT_LAW,
    prior: bool = True,
    test: bool = True,
    listener: Listener | None = None,
) -> CalibrationResult:
    """Return Young's modulus and Poisson's ratio of the gel that a recording pressed.

    Parameters
    ----------
    recording
        Folder of a recording, a `Recording`, or one that is certified already.
    law
        Contact law or its key. "default": the flat punch with kappa from first principles (the ball or the cone
        where no punch is flat); "paper": the published route, without nu from the rise.
    prior
        Bound nu by the range of elastomers where the recording does not state nu.
    test
        Test whether the law explains the measurements, which takes some tenths of a second.
    listener
        Receives progress and warnings while the call runs.

    Returns
    -------
    CalibrationResult
        E in MPa, nu, c in N/mm and beta, each with its 95 % interval; rejected presses with their reasons,
        assumptions, warnings and flags. A quantity that the data do not determine has no value and says why.

    Raises
    ------
    RecordingError
        Where the folder is no recording, or lacks what certification needs.
    NothingCertified
        Where every press is rejected.
    InputError
        Where no contact law explains the measurements.

    Examples
    --------
    >>> from tactilevision import calibrate_recording
    >>> result = calibrate_recording("sample_frames/hidden_material")
    >>> print(result.youngs_modulus.value, result.youngs_modulus.interval95)  # MPa
    >>> print(result.poisson_ratio.value, result.poisson_ratio.interval95)
    >>> print(result.presses_rejected, result.warnings)
    """
    heard = listener or Collected()
    one = certify_recordings(recording, poisson_ratio=law == DEFAULT_LAW, listener=heard)[0]
    found = calibrate_certified(one, law=law, prior=prior, test=test)
    if found.result is None:
        assert found.fault is not None
        raise found.fault
    heard.warn([line for line in found.result.warnings if line not in one.warnings])
    return found.result


def diagnose_recording(
    recordings: Given | Sequence[Given],
    *,
    effects: Sequence[Effect] = (),
    known: Sequence[Effect] = (),
    prior: bool = True,
    seed: int = 0,
    deadline: Deadline = NEVER,
    workers: int | None = 1,
    cluster: str | None = None,
    listener: Listener | None = None,
) -> Diagnosis:
    """Return what the contact model lacks on recordings of one sensor, and how certain that is.

    Parameters
    ----------
    recordings
        Folders of recordings of one sensor, `Recording` objects, or recordings that are certified already.
    effects
        Effects of your own that are searched besides the catalogue.
    known
        Effects that are in the model from the start.
    prior
        Bound nu by the range of elastomers where nu is not stated.
    seed
        Seed of the bootstrap and the permutations.
    deadline
        Moment after which nothing new is begun; the answer is then the best so far.
    workers
        Processes that share the search; None: one a core.
    cluster
        Address of a Dask cluster that is used instead.
    listener
        Receives progress and warnings while the call runs.

    Returns
    -------
    Diagnosis
        Verdict (see `calibration.diagnosis.decision.decide`), effects with sizes, errors in N, material before and
        after in MPa, limits of the data and next measurements.

    Raises
    ------
    RecordingError
        Where a folder is no recording, or lacks what certification needs.
    NothingCertified
        Where every press is rejected.
    InputError
        Where no contact law can be fitted.

    Examples
    --------
    >>> from tactilevision import diagnose_recording
    >>> found = diagnose_recording("sample_frames/hidden_material")
    >>> print(found.verdict, [effect.key for effect in found.effects])
    >>> print(found.errors.held_out_before, found.errors.held_out_after)  # N
    >>> print(found.material.after.youngs_modulus)  # MPa
    """
    heard = listener or Collected()
    certified, data, known_of_nu = _to_compare(recordings, heard, cluster=cluster, prior=prior)
    with step_pool(workers, cluster) as each, heard.progress_bar("diagnosing:") as progress:
        watch = Watch(progress, deadline, each)
        rng = np.random.default_rng(seed)
        found = diagnose(data, rng, effects=effects, known=known, watch=watch, **known_of_nu)
    heard.warn(found.material.after.warnings)
    before, after = (with_warnings_of(one, certified) for one in (found.material.before, found.material.after))
    return replace(found, material=replace(found.material, before=before, after=after))


def compare_recordings(
    recordings: Given | Sequence[Given],
    effects: Sequence[Effect | str],
    *,
    left_out: Sequence[str] = (),
    prior: bool = True,
    seed: int = 0,
    deadline: Deadline = NEVER,
    listener: Listener | None = None,
) -> Comparison:
    """Return the errors of the base law and of `effects` added one after the other; presses `left_out` not fitted.

    An effect is one of the catalogue by its key, or one of your own. The other parameters and the errors raised
    are those of `diagnose_recording`.
    """
    heard = listener or Collected()
    _, data, known_of_nu = _to_compare(recordings, heard, left_out=left_out, prior=prior)
    with heard.progress_bar("fitting") as progress:
        rng = np.random.default_rng(seed)
        return compare(data, effects, rng=rng, progress=progress, deadline=deadline, **known_of_nu)


def _to_compare(
    recordings: Given | Sequence[Given],
    listener: Listener,
    *,
    prior: bool,
    cluster: str | None = None,
    left_out: Sequence[str] = (),
) -> tuple[list[CertifiedRecording], Observations, dict[str, Any]]:
    """Return the recordings certified, their measurements, and what is known of nu: by the rise and its range."""
    certified = certify_recordings(recordings, scale_doubt=False, cluster=cluster, listener=listener)
    nu = {"bulge": sharpest_poisson_ratio(certified), "bound": NU_SILICONE if prior else None}
    return certified, observed(certified, left_out), nu


def validate_recording(
    recording: Given, *, calibration: Path | None = None, listener: Listener | None = None
) -> Validation:
    """Return finite elements against the measured forces and depths.

    The material is that of the file `calibration`, of calibration.json in the recording's folder, or else
    calibrated now; where the data leave nu open, the middle of its interval is taken, with a warning.
    """
    from calibration.tasks.validate import middle_material, validate  # with finite elements, which take a while
    from tactilevision.force.calibrated import read_material

    heard = listener or Collected()
    one = certify_recordings(recording, listener=heard)[0]
    data, stored = observe([one.measured]), one.recording.path / "calibration.json"
    if calibration is not None or stored.is_file():
        material = read_material(calibration or stored)
    else:
        result = calibrate_recording(one, test=False)
        material = result.material or middle_material(result.poisson_ratio.interval95, result.youngs_modulus_of_nu)
        if result.material is None:
            nu = f"{material.poisson_ratio:.3f}"
            heard.warn([f"the data do not fix nu: the middle of its interval, {nu}, is taken, and E that fits it"])
    with heard.progress_bar("finite elements") as progress:
        return validate(data, material, progress=progress)


def fit(
    depth_mm: npt.ArrayLike,
    force_N: npt.ArrayLike,
    *,
    radius_mm: npt.ArrayLike,
    thickness_mm: npt.ArrayLike,
    nu: npt.ArrayLike | None = None,
    time_s: npt.ArrayLike | None = None,
    press: Sequence[object] | None = None,
) -> CalibrationResult:
    """Fit c, beta and E to depths and forces of flat punches on a bonded layer; the model is that of `calibrate`.

        P = c w (1 + beta w/h),    c = 2 E a kappa(a/h, nu) / (1 - nu^2)

    Parameters
    ----------
    depth_mm, force_N
        Depth w and normal force P of N samples, both positive into the gel.
    radius_mm, thickness_mm
        Radius a of the punch, one number or one a sample, and thickness h of the gel.
    nu
        Poisson's ratio as it is known. None: that of elastomers, .45 to .4999; E then has an interval alone, or a
        value where several radii determine nu.
    time_s, press
        Times (N,) of readings, and labels (N,) of the presses to which they belong (None: to one), whose errors
        they share. Without times each sample is a press of its own.

    Returns
    -------
    CalibrationResult
        c in N/mm, beta and E in MPa with 95 % intervals; `plot_fit()` and `to_frame()` show the fit.

    Raises
    ------
    InputError
        For arrays of other shapes, numbers that are not finite or positive, and depths that determine no law.

    Examples
    --------
    >>> from tactilevision import fit
    >>> result = fit([0.15, 0.3, 0.4, 0.5, 0.6], [0.57, 1.2, 1.69, 2.18, 2.75], radius_mm=2.5, thickness_mm=3)
    >>> print(result.c.value, result.beta.value, result.youngs_modulus.interval95)
    """
    table = samples_of(
        depth_mm=depth_mm, force_N=force_N, radius_mm=radius_mm, thickness_mm=thickness_mm, nu=nu, time_s=time_s
    )
    return calibrate(measured_of(table, press), test=False)


# Certification.


def certify_recordings(
    recordings: Given | Sequence[Given],
    *,
    poisson_ratio: bool = True,
    scale_doubt: bool = True,
    cluster: str | None = None,
    listener: Listener | None = None,
) -> list[CertifiedRecording]:
    """Read recordings and certify those that have frames.

    Those that are certified already come first, then the others, the oldest first. `poisson_ratio`: estimate nu
    from the rise as well. `scale_doubt`: warn where certified depths contradict the picture's scale, which a
    diagnosis looks for anyway. On a cluster each recording is a task of its own, whose reconstructor stays there.
    """
    given = [recordings] if isinstance(recordings, str | Path | Recording | CertifiedRecording) else recordings
    done = [one for one in given if isinstance(one, CertifiedRecording)]
    rest = [one for one in given if not isinstance(one, CertifiedRecording)]
    heard = listener or Collected()
    how: dict[str, Any] = {"poisson_ratio": poisson_ratio, "scale_doubt": scale_doubt}
    if cluster is not None:
        return [*done, *_certify_on_cluster(oldest_first(rest), cluster, heard, how)]
    opened = read_recordings(rest)
    for recording in opened:
        heard.warn(recording.warnings)
    return [*done, *(_certify(one, heard, **how) for one in opened)]


def _certify(
    recording: Recording, listener: Listener, *, poisson_ratio: bool, scale_doubt: bool
) -> CertifiedRecording:
    """Return the recording with its certificate, where it has frames; `listener` hears its warnings at once."""
    if not recording.frame_names:
        return CertifiedRecording(recording)
    with listener.progress_bar("calibrating the light:") as progress:
        method = "polynomial" if recording.balls else None
        reconstructor = build_reconstructor(recording, method, progress=progress)
    listener.warn(reconstructor.warnings)
    maps: dict[str, HeightMap | None] = {}  # of the events; those of a kept certificate are made again

    def made() -> tuple[Certificate, Estimate | None]:
        with listener.progress_bar("certifying presses") as progress:
            found, nu = certify(recording, reconstructor, progress=progress), None
        if poisson_ratio:  # depths are corrected by it where nothing better is stated
            with listener.progress_bar("reading the gel outside the contact"):
                found, nu = with_nu(recording, reconstructor, certificate=found)
        maps.update({name: one.height_map for name, one in found.evidence.items()})
        bare = {name: replace(one, height_map=None) for name, one in found.evidence.items()}
        return replace(found, evidence=bare), nu

    certificate, nu = (
        made() if method is None else kept_record("certificate", (poisson_ratio, content_of(recording)), make=made)
    )
    evidence = {
        name: replace(one, height_map=maps[name] if maps else event_map(recording, reconstructor, one.frame_index))
        for name, one in certificate.evidence.items()
    }
    certificate = replace(certificate, evidence=evidence)
    certificate = certificate if scale_doubt else certificate.without_scale_doubt()
    listener.warn(certificate.warnings)
    certificate = replace(certificate, warnings=(*reconstructor.warnings, *certificate.warnings))
    return CertifiedRecording(recording, certificate, reconstructor, nu)


# From certified recordings to what a fit takes, and to its result.


def calibrate_certified(
    certified: CertifiedRecording, *, law: Law | str = DEFAULT_LAW, prior: bool = True, test: bool = True
) -> Calibrated:
    """Return the material of a certified recording, or why its presses determine none; `test` as in `calibrate`.

    Raises InputError where the measurements were wrong as they came, before any press was looked at.
    """
    clock, points = certified.clock_offset, certified.points
    bound, nu = NU_SILICONE if prior else None, certified.poisson_ratio if law == DEFAULT_LAW else None
    try:
        result = calibrate(certified.measured, law=law, clock_offset=clock, bulge=nu, bound=bound, test=test)
    except (NothingCertified, InputError) as fault:
        brought = certified.certificate is None and all(point.accepted for point in points)
        if isinstance(fault, InputError) and brought:
            raise
        gel, why, key = certified.recording.sensor.gel, str(fault), law if isinstance(law, str) else law.key
        warnings = certified.warnings
        content = unfixed_as_json(gel, points, why=why, law=key, clock_offset=clock, warnings=warnings)
        return Calibrated(certified, content, fault=fault)
    result = with_warnings_of(result, [certified])
    return Calibrated(certified, result.as_json(), result)


def calibrate_each(
    recordings: Sequence[Source],
    *,
    law: str = DEFAULT_LAW,
    prior: bool = True,
    test: bool = True,
    cluster: str | None = None,
    listener: Listener | None = None,
) -> list[Calibrated]:
    """Calibrate each recording by itself, the oldest first; a cluster certifies them."""
    nu = law == DEFAULT_LAW
    certified = certify_recordings(recordings, poisson_ratio=nu, cluster=cluster, listener=listener)
    return [calibrate_certified(one, law=law, prior=prior, test=test) for one in certified]


def with_warnings_of(result: CalibrationResult, certified: Sequence[CertifiedRecording]) -> CalibrationResult:
    """Return the result with the warnings and flags of what it was fitted to, before its own."""
    read = (line for one in certified for line in one.warnings)
    flags = (flag for one in certified if one.certificate for flag in one.certificate.flags)
    return replace(
        result,
        warnings=tuple(dict.fromkeys((*read, *result.warnings))),
        flags=tuple(dict.fromkeys((*result.flags, *flags))),
    )


def sharpest_poisson_ratio(certified: Sequence[CertifiedRecording]) -> Estimate | None:
    """Return nu from the rise of the recording that determines it best; None where none does."""
    known = [one.poisson_ratio for one in certified if one.poisson_ratio is not None]
    known = [nu for nu in known if nu.value is not None and nu.std]
    return min(known, key=lambda nu: nu.std or 0.0, default=None)


def observed(certified: Sequence[CertifiedRecording], left_out: Sequence[str] = ()) -> Observations:
    """Return the curves of these recordings where there are any, else the points, without presses `left_out`."""
    sets = [one.measured for one in certified]
    return leave_out(observe_curves(sets) if any(one.curves for one in sets) else observe(sets), left_out)


def height_residuals(certified: Sequence[CertifiedRecording]) -> list[ResidualMap]:
    """Return the mean residual of each recording's height maps against the expected surface."""
    from calibration.report.drawing import residual_map

    maps = (
        residual_map(list(_surfaces(one)), one.recording.sensor.gel)
        for one in certified
        if one.recording.sensor.gel is not None
    )
    return [one for one in maps if one is not None]


def _surfaces(certified: CertifiedRecording) -> Iterator[Any]:
    from calibration.report.drawing import Surface

    for point in certified.points if certified.certificate else ():
        assert certified.certificate is not None
        evidence = certified.certificate.evidence.get(point.press)
        if point.accepted and evidence is not None and evidence.height_map is not None and evidence.footprint:
            punch = certified.recording.indenters[point.indenter]
            centre = evidence.footprint.centre_mm
            yield Surface(evidence.height_map, centre, punch.radius_mm, point.depth_mm, punch.bevel)


# Each recording as a task of its own on a Dask cluster: its certificate and its warnings travel back.


def _certify_on_cluster(
    given: Sequence[Recording], cluster: str, listener: Listener, how: dict[str, Any]
) -> list[CertifiedRecording]:
    """Certify each recording in order, pass its warnings on and raise its errors.

    It writes nothing, so a task that is lost is done again. Raises ClusterError as `cluster_pool` does.
    """
    with cluster_pool(cluster) as pool, listener.progress_bar("certifying recordings") as progress:
        tasks = [pool.submit(_certify_there, one.path.absolute(), how) for one in given]
        found: list[CertifiedRecording] = []
        for task, recording in zip(tasks, given, strict=True):
            outcome, warnings = task.result()
            listener.warn(warnings)
            if isinstance(outcome, TactilevisionError):
                raise outcome
            found.append(replace(outcome, recording=recording))
            progress(len(found), len(given))
    return found


def _certify_there(path: Path, how: dict[str, Any]) -> tuple[CertifiedRecording | TactilevisionError, list[str]]:
    """Return a recording certified, without its reconstructor, which is large, or why not; and its warnings."""
    heard = Collected()
    try:
        return replace(certify_recordings([path], **how, listener=heard)[0], reconstructor=None), heard.warnings
    except TactilevisionError as fault:
        return fault, heard.warnings
