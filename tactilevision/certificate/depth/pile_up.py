"""How far the gel rises where the bevel meets it, and the depth that the bevel then certifies.

    touch:  w + u_z(r_bevel, w) = H        rho = u_z / w  (positive out of the gel)      w = H / (1 + rho)

Seen: rho is the slope of the rise against the depth of the face over the frames before the touch. The rise comes
from the height map, the depth from the force, in the scale that the bevels certify. A slope is free of the zero
plane. Without tilt the rise is the same all round, so the mean over a ring is taken. Its uncertainty holds the
scatter of the ring's quarters, the error of the map's depth scale on the faces, and the map's own error at the
ring. Computed: the profile beside a flat punch on a bonded layer, for what is known of the gel's Poisson ratio.

The two are checked against each other and combined by their variances. Where the bevel's place is neither given
nor seen, w = H is kept with what that may be wrong. Source:
docs/explanation/physics.md, "The bevel touches early".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.certificate.touch.press_track import PressTrack
from tactilevision.contact.bevel import EDGE_MM
from tactilevision.mechanics.tables.profile import profile_model
from tactilevision.mechanics.touch import touch_depth
from tactilevision.records import Bools, Floats, Gel, Indenter

_HALF_RING_MM = 0.3  # mm, half the width of the ring in which the rise is read; benchmarks.certificate
_SOFT_GEL = (0.45, 0.4999)  # Poisson's ratio of silicones and the like, where nothing is said of the gel
_SINKS = 1.4  # of the radius, within which the gel sinks in
_SUNK = 1.5  # of the height, the depth at touch where the gel sinks in
_STATED_STD = 0.01  # of a Poisson's ratio stated without one
_UNKNOWN = (0.0, 0.13)  # the rise over the depth anywhere beyond 1.3 radii, for any such gel


@dataclass(frozen=True, slots=True)
class PileUp:
    """rho at the bevel's edge and its std, and what it rests on: seen and computed (ratio, std), None if not
    known.
    """

    ratio: float
    std: float
    seen: tuple[float, float] | None = None
    computed: tuple[float, float] | None = None

    @property
    def disagreement(self) -> float:
        """Sigmas between what is seen and what is computed."""
        if self.seen is None or self.computed is None:
            return 0.0
        return abs(self.seen[0] - self.computed[0]) / float(np.hypot(self.seen[1], self.computed[1]))


def unknown_pile_up() -> PileUp:
    """Nothing is known of the bevel's place: w = H, and how far that may be off."""
    return PileUp(0.0, (_UNKNOWN[1] - _UNKNOWN[0]) / float(np.sqrt(3)))


def press_pile_up(
    track: PressTrack, depth_mm: Floats, *, before: Bools, distance_mm: float
) -> tuple[Floats, Floats] | None:
    """rho (4,) of the quarters of the ring and its std, from one press; `depth_mm` (N,), `before` the touch
    (N,).
    """
    ring = np.abs(track.r_mm - distance_mm) <= _HALF_RING_MM
    use = before & np.isfinite(depth_mm)
    if use.sum() < 4 or not ring.any() or np.ptp(depth_mm[use]) <= 0:
        return None
    depth = depth_mm[use]
    level = track.rings[use][:, :, ring].mean(axis=2)
    unseen = ~np.isfinite(level).all(axis=0)
    level = np.where(np.isfinite(level), level, 0.0)
    design = np.c_[np.ones_like(depth), depth]
    answer, *_ = np.linalg.lstsq(design, level, rcond=None)
    spread = (level - design @ answer).std(axis=0) / np.sqrt(((depth - depth.mean()) ** 2).sum())
    return np.where(unseen, np.nan, -answer[1]), np.where(unseen, np.nan, spread)


def map_error(track: PressTrack, depth_mm: Floats, *, distance_mm: float) -> float:
    """What the deepest height map may be off by all round the ring, over the depth `depth_mm` (N,) there; NaN
    where the map does not say.

    A colour law that misreads gentle slopes does so all round and in every press: no scatter shows it.
    """
    height, face, deepest = track.face_map, track.footprint, float(depth_mm[track.deepest])
    if height.std_mm is None or face is None or not deepest > 0:
        return float("nan")
    rows, columns = height.depth_mm.shape
    x = (np.arange(columns) - (columns - 1) / 2) * height.mm_per_px[0] - face.centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2) * height.mm_per_px[1] - face.centre_mm[1]
    ring = np.abs(np.hypot(x[None, :], y[:, None]) - distance_mm) <= _HALF_RING_MM
    std = np.asarray(height.std_mm, dtype=np.float64)[ring & height.valid]
    std = std[np.isfinite(std)]
    return float(std.mean()) / deepest if std.size else float("nan")


def seen_ratio(
    found: Sequence[tuple[Floats, Floats]], *, scale_std: float, map_std: float = 0.0
) -> tuple[float, float] | None:
    """One rho and its std from ratios (4,) and stds (4,) of many presses.

    `scale_std` is the relative uncertainty of the height map's scale, `map_std` what its rise may be off by over
    the depth.
    """
    if not found:
        return None
    ratios, stds = np.array([f[0] for f in found]), np.array([f[1] for f in found])
    weights = np.where(np.isfinite(ratios), 1 / np.maximum(stds, 1e-4) ** 2, 0.0)
    total = weights.sum(axis=0)
    seen = total > 0
    if seen.sum() < 2:
        return None
    quarters = (np.where(np.isfinite(ratios), ratios, 0.0) * weights).sum(axis=0)[seen] / total[seen]
    value = float(quarters.mean())
    # the quarters err by what the method has wrong in each direction, which more presses do not mend
    spread = float(quarters.std(ddof=1) / np.sqrt(seen.sum()))
    return value, float(np.sqrt(spread**2 + 1 / total[seen].sum() + (scale_std * value) ** 2 + map_std**2))


def computed_ratio(gel: Gel | None, indenter: Indenter, *, distance_mm: float) -> tuple[float, float] | None:
    """rho and its std from the layer's profile and what is known of Poisson's ratio."""
    if gel is None or indenter.height_mm is None or not distance_mm > indenter.radius_mm:
        return None
    nu, nu_std = gel.poisson_ratio, gel.poisson_ratio_std or _STATED_STD
    if nu is None:
        nu, nu_std = 0.5 * sum(_SOFT_GEL), (_SOFT_GEL[1] - _SOFT_GEL[0]) / float(np.sqrt(12))
    if not 0 < indenter.height_mm < 0.25 * gel.thickness_mm:
        return None
    nu, h = min(nu, 0.4999), gel.thickness_mm
    # near a punch, which the gel sinks in with, the depth at touch may exceed the height
    deepest = indenter.height_mm * (_SUNK if distance_mm < _SINKS * indenter.radius_mm else 1.0)
    model = profile_model(nu, indenter.radius_mm / h, deepest=deepest / h)
    touch = touch_depth(
        replace(indenter, bevel_distance_mm=distance_mm),
        thickness_mm=h,
        poisson_ratio=nu,
        poisson_ratio_std=nu_std,
        model=model,
    )
    return touch.rise_over_depth, touch.rise_over_depth_std


def blur_place(pile_up: PileUp, gel: Gel | None, *, indenter: Indenter, distance_mm: float) -> PileUp:
    """The rise with what it may be off by where the bevel's place was found, to about its window."""
    near, far = (computed_ratio(gel, indenter, distance_mm=distance_mm + sign * EDGE_MM) for sign in (-1, 1))
    if near is None or far is None:
        return pile_up
    return replace(pile_up, std=float(np.hypot(pile_up.std, 0.5 * (near[0] - far[0]))))


def combine(seen: tuple[float, float] | None, computed: tuple[float, float] | None) -> PileUp:
    """By inverse variance; where they contradict each other the std grows until they do not."""
    if seen is None or computed is None:
        known = seen or computed
        return unknown_pile_up() if known is None else PileUp(known[0], known[1], seen, computed)
    weights = np.array([1 / seen[1] ** 2, 1 / computed[1] ** 2])
    value = float(np.average([seen[0], computed[0]], weights=weights))
    apart = abs(seen[0] - computed[0]) / float(np.hypot(seen[1], computed[1]))
    return PileUp(value, float(max(apart, 1.0) / np.sqrt(weights.sum())), seen, computed)


def depth_std(
    depth_mm: float,
    pile_up: PileUp,
    *,
    height_std_mm: float,
    scale_std: float | None = None,
    tilt_std_mm: float = 0.0,
) -> float:
    """Std (mm) of a certified depth from machined height, pile-up and tilt.

    On a travel scale `scale_std`, its relative std, takes the place of height and tilt.
    """
    from_pile_up = depth_mm * pile_up.std / (1 + pile_up.ratio)
    if scale_std is not None:
        return float(np.hypot(from_pile_up, depth_mm * scale_std))
    return float(np.linalg.norm([height_std_mm / (1 + pile_up.ratio), from_pile_up, tilt_std_mm]))
