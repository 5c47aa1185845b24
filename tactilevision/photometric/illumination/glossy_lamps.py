"""Lamps by a fit that knows gloss, raised gel and the light that level gel sends to a slope.

`lamps.py` has matt gel at one height. The gel under a ball stands nearer to the lamps and gets less of their
light, its lit side shines, and its dark side gets light from the level gel around. Left out, lamps come out 5 to
15 % low: so much too long their shadows are forecast. Here a lamp gives to a normal n at height z, level untouched
gel = 1,

    s_l = (max(e_l(P, z).n, 0)/e_lz(P, 0) + k G(n) + rho (1 - n_z)/2) / (1 + k G_0)
    G(n) = |e_l| exp(-tan^2 t/alpha^2) / (4 alpha^2 cos^4 t n_z e_lz(P, 0))     t: from n to half-way to the lamp

the first as a mean over the lamp's points, seen from straight above: Beckmann's lobe of strength k and width
alpha, the same for all lamps. All else is as in lamps.py. How right it is stands in docs/evidence/rendered.md.
Source: Beckmann, Spizzichino (1963), as in Walter et al., EGSR 2007; light on raised gel: Quéau et al. (2018).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tactilevision.photometric.illumination.lamps import (
    MAX_KNOWN,
    MIN_COUNT,
    SAMPLES,
    SOFT,
    Lamp,
    Lamps,
    LampTask,
)
from tactilevision.photometric.reference import Reference
from tactilevision.records.measured import Floats, Pair

REFLECTANCE = 0.5  # of the ink, as in interreflection.py
PRIOR_GLOSS = (np.log(0.05), 1.0)  # ln k and its deviation
PRIOR_WIDTH = (np.log(0.35), 0.35)  # ln alpha and its deviation
STEEPEST_COS = 1e-3  # of the angle between a normal and half-way: no lobe reaches farther


def fit_glossy_lamps(
    change: Floats,
    slopes: Floats,
    *,
    height_mm: Floats,
    place: Floats,
    reference: Reference,
    mm_per_px: Pair,
    like: Lamps | None = None,
) -> Lamps | None:
    """As `fit_lamps`, of samples that stand `height_mm` (N,) over the untouched gel; as many lamps as `like`."""
    if len(place) < MIN_COUNT:
        return None
    some = np.linspace(0, len(place) - 1, min(SAMPLES, len(place))).astype(np.intp)
    task = _GlossyTask.of(change[some], slopes[some], place[some], reference, mm_per_px)
    return replace(task, height_mm=height_mm[some], like=like).solved()


@dataclass(frozen=True)
class _GlossyTask(LampTask):
    """Two more parameters: ln k and ln alpha."""

    others: int = 7
    height_mm: Floats | float = 0.0
    like: Lamps | None = None
    shadings: dict[tuple[Lamp, float, float], tuple[Floats, Floats]] = field(default_factory=dict)

    @cached_property
    def normals(self) -> Floats:
        """Of the surface under the balls (3, n)."""
        normals = np.concatenate([-self.slopes, np.ones((1, self.slopes.shape[1]))])
        return np.asarray(normals / np.linalg.norm(normals, axis=0))

    def start(self) -> Floats:
        more = self.like is not None and len(self.like.lamps) > 3
        first = self.parameters(self.like) if self.like and more else super().start()
        return np.concatenate([first, [PRIOR_GLOSS[0], PRIOR_WIDTH[0]]])

    def of_balls(self, values: Floats) -> Floats:
        lamps, others = self.lamps(values), self.parts(values)[1]
        shades, upright = zip(*(self._shading(lamp, *np.exp(others[5:])) for lamp in lamps), strict=True)
        return self._off_balls(self._seen(lamps, np.stack(upright), np.stack(shades)), power=float(others[0]))

    def _shading(self, lamp: Lamp, gloss: float, width: float) -> tuple[Floats, Floats]:
        """s_l (n,), and the light upright on untouched gel (n,), whatever the lamp's colour."""
        key = replace(lamp, colour=(0.0, 0.0, 0.0)), float(gloss), float(width)
        if key not in self.shadings:
            if len(self.shadings) > MAX_KNOWN:
                self.shadings.clear()
            raised, level = lamp.lights(self.x_mm, self.y_mm, self.height_mm), lamp.light(self.x_mm, self.y_mm)
            turned = np.einsum("kdn,dn->kn", raised, self.normals) / level[2]
            matt = 0.5 * (turned + np.sqrt(turned**2 + SOFT**2)).mean(axis=0)
            up = np.broadcast_to(np.array([0.0, 0.0, 1.0])[:, None], level.shape)
            shine, shine_level = (
                gloss * _lobe(light, normals, width) / level[2]
                for light, normals in ((raised.mean(axis=0), self.normals), (level, up))
            )
            around = REFLECTANCE * 0.5 * (1.0 - self.normals[2])
            self.shadings[key] = (matt + shine + around) / (1.0 + shine_level), level[2]
        return self.shadings[key]

    def priors(self, values: Floats) -> Floats:
        pairs = zip(self.parts(values)[1][5:], (PRIOR_GLOSS, PRIOR_WIDTH), strict=True)
        return np.concatenate([super().priors(values), [(value - mean) / std for value, (mean, std) in pairs]])


def _lobe(light: Floats, normals: Floats, width: float) -> Floats:
    """Gloss seen from above (n,) of light (3, n) on normals (3, n)."""
    size = np.linalg.norm(light, axis=0)
    half = light / size
    half[2] += 1.0
    half /= np.linalg.norm(half, axis=0)
    cosine = np.clip(np.sum(half * normals, axis=0), STEEPEST_COS, 1.0)
    lobe = np.exp(-(cosine**-2 - 1.0) / width**2) / (4.0 * width**2 * cosine**4)
    return np.asarray(size * lobe / normals[2])
