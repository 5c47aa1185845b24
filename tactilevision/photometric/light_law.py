"""The light's law kept with a method: which colour a slope should have, and how far balls left out had another.

    share^2 = sum over patches of balls left out of <u - u_law(p, q)>^2 / sum of <u>^2

u is the change of colour, u_law the shading law (ball/shading_fit.py) of the other balls, p and q the slopes that
their colour law reads; < > is the mean over a patch, which counts as often as it has samples. What a frame's
colours have beyond that, the light that the balls saw does not explain (quality/inconsistent_light.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tactilevision.photometric.ball.cross_validation import groups_of, patches_of
from tactilevision.photometric.ball.samples import Samples
from tactilevision.photometric.ball.shading_fit import PLACE_PENALTIES, colours_of, fit_light
from tactilevision.photometric.protocols import ColourLaw, Picture
from tactilevision.records import Floats


@dataclass(frozen=True, slots=True)
class LightLaw:
    """`terms` (46, 3) of the shading law; `share` of a change of colour that it is off by at balls left out.

    `noise` (3, h, w): what untouched gel is off by; `limit`: what ball pictures reach, in deviations. Both are
    measured when a reader is made; an infinite limit flags nothing.
    """

    terms: Floats
    share: float
    noise: Picture = field(default_factory=lambda: np.zeros((3, 1, 1), np.float32))
    limit: float = np.inf

    def arrays(self) -> dict[str, Floats]:
        """As they are stored: `terms`, `noise`, and `limits` (share, limit)."""
        return {
            "terms": self.terms,
            "noise": self.noise.astype(np.float64),
            "limits": np.array([self.share, self.limit]),
        }


def fit_light_law(contact: Samples, held_out: Floats, *, others: Sequence[ColourLaw]) -> LightLaw | None:
    """The light's law of samples of balls; `held_out` slopes (N, 2) by `others`, each of which lacks a group.

    None where only two colours tell the balls: they leave no residual.
    """
    if not contact.change.any(axis=0).all():
        return None
    patch, count = patches_of(contact)
    off = np.empty_like(contact.change)
    for group, _ in zip(groups_of(contact), others, strict=True):
        out = np.isin(contact.press, group)
        light = fit_light(contact.where(~out), PLACE_PENALTIES[1])
        off[out] = contact.change[out] - colours_of(light, held_out[out], place=contact.place[out])
    misfit, size = (
        sum(float(np.sum(np.bincount(patch, column) ** 2 / count)) for column in many.T)
        for many in (off, contact.change)
    )
    return LightLaw(fit_light(contact, PLACE_PENALTIES[1]), float(np.sqrt(misfit / size)))
