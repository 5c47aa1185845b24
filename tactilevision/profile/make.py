"""Sensor profiles made from a recording, its reconstructor and, where known, E, nu and certified faces."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from tactilevision.errors import InputError
from tactilevision.force.compliance import gel_compliance
from tactilevision.force.field import ForceSettings
from tactilevision.force.folder import untouched_frame
from tactilevision.force.nodes import lay_grid
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.reference_match import some_frames
from tactilevision.photometric.card import provenance
from tactilevision.press.certified_faces import DepthScale, with_walls
from tactilevision.profile.model import Followed, Profile
from tactilevision.recording.model import Recording
from tactilevision.records.constants import Z95
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Gel
from tactilevision.shear.displacement import read_untouched


def make_profile(
    recording: Recording,
    reconstructor: Reconstructor,
    *,
    calibration: Mapping[str, Any] | None = None,
    face_law: DepthScale | None = None,
) -> Profile:
    """Return the profile of a recording's sensor, read by its `reconstructor`.

    The method keeps the walls' law of certified faces; `face_law` is the true over the read depth of these faces.
    `calibration` is the content of calibration.json; without one, E and nu are those stated of the gel. Where gel,
    E and nu are known its compliance is computed, which takes half a minute near free sides. Raises InputError
    where the method has no reference, or E and nu are not fixed.
    """
    method, picture, sensor = reconstructor.referenced, untouched_frame(recording), recording.sensor
    if method is None or picture is None or recording.frame_size_px is None:
        raise InputError(
            "a profile needs a method with a reference, and a picture of the untouched gel",
            where=recording.path,
            remedy="Name the picture with --reference.",
        )
    source = f"{recording.name}: {len(recording.balls)} ball presses, {len(recording.flats)} flats"
    about = provenance(source, licence="")
    today = datetime.datetime.now(tz=datetime.UTC).date()
    made = Profile(
        sensor,
        with_walls(method, reconstructor.taught),
        picture,
        recording.frame_size_px,
        (recording.date or today).isoformat(),
        followed_in(recording, picture),
        about["data"],
        recording.white_level,
        calibration or stated_material(sensor.gel),
        face_law=face_law,
        indenters=recording.indenters,
        versions=about["versions"],
        warnings=(*recording.warnings, *reconstructor.warnings),
        path=recording.path,
    )
    return with_compliance(made)


def followed_in(recording: Recording, untouched: Bytes) -> Followed:
    """Return which pattern of the `untouched` picture (H, W, 3), grey levels, single frames show above noise."""
    sensor = recording.sensor
    found = read_untouched(untouched, sensor.mm_per_px, markers=sensor.has_markers or None)
    if found.markers is not None:
        return "markers"
    if found.shows and any(found.shear(rgb).valid.any() for rgb in some_frames(recording)):
        return "texture"
    return "nothing"


def with_compliance(profile: Profile) -> Profile:
    """Return the profile with its gel's compliance; unchanged where gel, E or nu are not known."""
    gel, material, sensor = profile.sensor.gel, profile.material, profile.sensor
    if gel is None or material is None:
        return profile
    view = (sensor.height_px, sensor.width_px)
    grid = lay_grid(view, sensor.mm_per_px, spacing_mm=ForceSettings().spacing_mm)
    made = gel_compliance(gel, grid, poisson_ratio=material.poisson_ratio, slopes=True)
    return replace(profile, compliance=made)


def stated_material(gel: Gel | None) -> dict[str, Any] | None:
    """Return the gel's stated E and nu as in calibration.json; None where it does not state both."""
    if gel is None or gel.youngs_modulus_MPa is None or gel.poisson_ratio is None:
        return None
    return {
        "youngs_modulus_MPa": _estimate(gel.youngs_modulus_MPa, gel.youngs_modulus_std_MPa, "MPa"),
        "poisson_ratio": _estimate(gel.poisson_ratio, gel.poisson_ratio_std, "1"),
        "poisson_ratio_source": "prior",
        "gel": {"thickness_mm": gel.thickness_mm, "shape": gel.shape},
        "assumptions": ["E and nu are as stated of the gel, not measured here"],
    }


def _estimate(value: float, std: float | None, unit: str) -> dict[str, Any]:
    spread = std or 0.0
    ends = [value - Z95 * spread, value + Z95 * spread]
    return {"value": value, "std": spread, "interval95": ends, "unit": unit}
