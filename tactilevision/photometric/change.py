"""Colour change against the untouched gel: the quantity that slope is read from.

    u_c = (I_c / (1 + drift_c) - I0_c) / (I0_c + s)

Dividing by the local brightness makes u nearly the same function of slope all over the picture; the softening s
keeps dark places from blowing their noise up. Of the drift, the part that is the same everywhere divides; how it
leans over the picture is small, and applied to first order.
Marks on the gel are filled from around, in I0 once and in u frame by frame.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric.drift import Drift, DriftTracker
from tactilevision.photometric.marks import fill, marked
from tactilevision.photometric.reference import SATURATED, Reference
from tactilevision.records import Bools, Bytes

SOFTENING_GREY = 20.0
STRIP_PX = 32000  # pixels worked on at once, so that they stay in the cache

Planes = npt.NDArray[np.float32]


class ColourChange:
    """Turns rectified frames into colour changes (3, H, W) float32, in buffers made once."""

    def __init__(self, reference: Reference) -> None:
        self.reference = reference
        self.tracker = DriftTracker(reference)
        self._mean: Planes = np.array(reference.rgb.transpose(2, 0, 1), np.float32, order="C")
        if reference.marks is not None:
            fill(self._mean, reference.marks.mask)
        self.scale: Planes = np.empty_like(self._mean)
        self.x, self.y = (np.linspace(-1, 1, n, dtype=np.float32) for n in reference.shape[::-1])
        self._settle()
        self.noise: Planes = self.scale * np.asarray(reference.noise_grey, np.float32)[:, None, None]
        self._out: Planes = np.empty_like(self._mean)
        self._work = np.empty(reference.shape, np.float32)
        self._greys = list(np.empty((3, *reference.shape), np.uint8))
        self._rows = max(1, STRIP_PX // reference.shape[1])

    def measure(self, rgb: Bytes) -> tuple[Planes, Drift, Bools]:
        """Changes (3, H, W), drift, and validity (H, W) of a frame.

        The changes are overwritten by the next call.
        """
        self._check(rgb)
        drift = self.tracker.measure(rgb)
        cv2.split(rgb, self._greys)
        gains = (SOFTENING_GREY * (drift.gains + np.array([1.0, 0.0, 0.0]))).astype(np.float32)[:, :, None]
        down, across = (gains[:, 0] + gains[:, 2] * self.y)[..., None], (gains[:, 1] * self.x)[:, None]
        for c, grey in enumerate(self._greys):
            share = 1.0 / (1.0 + float(drift.gains[c, 0]))
            for top in range(0, rgb.shape[0], self._rows):
                rows = slice(top, top + self._rows)
                out, gain = self._out[c, rows], self._work[: len(grey[rows])]
                np.add(down[c, rows], across[c], out=gain)
                cv2.add(grey[rows], gain, dst=out, dtype=cv2.CV_32F)
                cv2.multiply(out, self.scale[c, rows], dst=out, scale=share)
                cv2.scaleAdd(gain, -share / SOFTENING_GREY, out, dst=out)
        if self.reference.marks is not None:
            fill(self._out, marked(rgb, self.reference.marks))
        brightest = cv2.max(cv2.max(self._greys[0], self._greys[1]), self._greys[2])
        return self._out, drift, self.reference.usable & (brightest < SATURATED)

    def follow(self, rgb: Bytes, share: float) -> None:
        """Move the mean untouched picture towards `rgb` by `share` of the difference, in place."""
        marks = self.reference.marks
        hidden = None if marks is None else marked(rgb, marks) > 0
        for c, grey in enumerate(cv2.split(rgb)):
            np.subtract(grey, self._mean[c], out=self._work)
            self._work *= np.float32(share)
            if hidden is not None:
                self._work[hidden] = 0.0
            self._mean[c] += self._work
        self.tracker.follow(rgb, share)
        self._settle()

    @property
    def level(self) -> Planes:
        """The untouched picture (3, H, W) that changes are counted from, without its marks."""
        return self._mean

    def _settle(self) -> None:
        np.add(self._mean, np.float32(SOFTENING_GREY), out=self.scale)
        np.reciprocal(self.scale, out=self.scale)

    def _check(self, rgb: Bytes) -> None:
        if rgb.shape != self.reference.rgb.shape or rgb.dtype != np.uint8:
            raise InputError(
                "the frame does not match the reference in size or type",
                where="frame",
                value=f"{rgb.shape} {rgb.dtype}, the reference has {self.reference.rgb.shape} uint8",
                remedy="Use frames and reference of the same sensor and stream.",
            )
