"""The term of the light's drift: what is not known of it, as depth.

A wrong coefficient g_k of the drift (photometric/illumination/drift.py) changes the colours of the whole picture.
With them it changes the surface, smoothly: by D_k(x, y) each. The zero plane takes off what of it is a plane on
the untouched gel,

    variance(x, y) = D' C D'        D'_k = D_k - plane of D_k      C: covariance of the coefficients

so that little is left beside small contacts, and much under those that leave little gel to tell drift from slopes.
Vanishes where nothing has drifted, and where D_k is a plane. D_k is worked out once, for colours of flat gel.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.integration.poisson import integrate
from tactilevision.integration.zero_plane import ZeroPlane, plane_terms
from tactilevision.photometric.illumination.camera_response import SOFTENING_GREY
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.records import Floats, Pair, SlopeMap

STEP = 0.01  # of a coefficient: laws are straight over it to a hundredth


class DriftError:
    """How depths of one method answer to its drift's coefficients; made once, on the drift's own blocks."""

    def __init__(self, method: ReferencedMethod, mm_per_px: Pair) -> None:
        tracker, shape = method.change.tracker, method.reference.shape
        self.blocks = (tracker.size[1], tracker.size[0])
        self.terms = plane_terms(shape, self.blocks)
        kept_share = cv2.resize(method.kept_share, tracker.size, interpolation=cv2.INTER_AREA)
        evaluate = method.law.evaluator(self.blocks)
        block_mm = tuple(
            n * mm / blocks for n, mm, blocks in zip(shape[::-1], mm_per_px, tracker.size, strict=True)
        )
        effects = tracker.effects / (tracker.level + SOFTENING_GREY)[:, None, :]
        depths = np.zeros(effects.shape)
        for channel, parts in enumerate(effects):
            for number, part in enumerate(parts):
                change = np.zeros((3, *self.blocks), np.float32)
                change[channel] = STEP * part.reshape(self.blocks)
                slopes = [
                    kept_share * (more - less) / (2.0 * STEP)
                    for more, less in zip(evaluate(change), evaluate(-change), strict=True)
                ]
                depths[channel, number] = integrate(SlopeMap(*slopes), (block_mm[0], block_mm[1])).ravel()

        self.depths = depths.reshape(-1, len(tracker.basis))  # of all coefficients, channel by channel

    def variance(self, covariance: Floats, zero: ZeroPlane) -> npt.NDArray[np.float32]:
        """Variance (rows, columns) of depth on the blocks, of a drift's `covariance` (18, 18), mm²."""
        depths = self.depths
        if zero.takes is not None:
            depths = depths - (depths @ zero.takes.T) @ self.terms
        return np.asarray(np.sum(depths * (covariance @ depths), axis=0), np.float32).reshape(self.blocks)
