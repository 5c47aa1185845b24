"""Find the row at which a picture is torn: above it the camera shows one moment, below it another.

Rows of the raw picture are compared in blocks b across it. With m_r(b) the mean change of grey in row r since the
reference, and s_r = m_r - m_(r-1), the step is

    E_r = rms over b and colours of (s_r - (s_(r-1) + s_(r+1)) / 2)

in units of its median over rows: of all, or of those that begin a block of JPEG. Optics and gel spread the edge of
a contact over several rows, and a contact has two edges; a tear lies between two rows and is the only one. Hence a
picture is torn where one row exceeds STEP, every row farther than FAR by ALONE times, and its neighbours by
SHARED, in colours or in their mean, which JPEG blurs less.

Of real pictures (eight sets of GelSlim, GelSight Mini and Wedge) torn at any row, 5 % are found where both moments
differ by less than 4 grey levels rms in the rows that meet, 40 % up to 8, 69 % up to 16 and 91 % beyond; saved as
JPEG afterwards, 2, 23, 49 and 68 %. The row is right, and none of 747 whole ones is called torn. Maps of torn
pictures that pass are off by .002 to .05 mm rms, .2 mm at most, where peaks are .2 to 1.4 mm.
"""

from __future__ import annotations

import cv2
import numpy as np
import scipy.sparse as sp

from tactilevision.heightmap.scene_faults import BLOCK
from tactilevision.photometric.colour_change import FrameChange
from tactilevision.records.measured import Floats, Picture
from tactilevision.records.rig import Sensor

ACROSS = 32  # blocks across the picture
STEP = 6  # times the median over rows: whole real pictures that stand alone reach 4.2
ALONE = 2  # times the step of any row farther than FAR: whole real pictures reach 1.7
BORDER = 8  # rows along the border in which no tear is sought
FAR = 4  # rows next to a tear that its compression may disturb
SHARED = 0.5  # of the step, in the next rows: interpolation of a rectified picture leaves .17, compression more
MIN_STEP_GREY = 0.1  # grey levels: least median step, of rounding


class TearCheck:
    """Finds torn pictures of one sensor; what only its rectification determines is computed once."""

    def __init__(self, sensor: Sensor) -> None:
        self.raw: sp.csr_array | None = None
        if sensor.rectification is not None:
            x, y = (np.rint(one.ravel()).astype(np.int64).clip(0) for one in sensor.rectification)
            places = y * ACROSS + x * ACROSS // (x.max() + 1)
            ones, size = np.ones(places.size, np.float32), ((y.max() + 1) * ACROSS, places.size)
            sums = sp.csr_array((ones, (places, np.arange(places.size))), shape=size)
            with np.errstate(divide="ignore"):
                self.raw = sp.diags_array(1.0 / sums.sum(axis=1), dtype=np.float32) @ sums
            self.unseen = sums.sum(axis=1) == 0

    def __call__(self, frame: FrameChange) -> int | None:
        """Return the first row of the raw picture below a tear; None for a whole picture."""
        return tear_of(self._rows(_grey(frame)))

    def _rows(self, grey: Picture) -> Floats:
        """Return the means (rows, ACROSS, 3) of a rectified picture (H, W, 3) in rows of the raw one."""
        if self.raw is None:
            means = cv2.resize(grey, (ACROSS, len(grey)), interpolation=cv2.INTER_AREA)
        else:
            means = self.raw @ grey.reshape(-1, 3)
            means[self.unseen] = np.nan
        return np.asarray(means.reshape(-1, ACROSS, 3))


def tear_of(rows: Floats) -> int | None:
    """Return the first row below a tear in means (rows, blocks, 3) of the change of grey, NaN where none."""
    return _tear_of(rows.reshape(len(rows), -1)) or _tear_of(rows.mean(axis=2))


def _tear_of(rows: Floats) -> int | None:
    steps = np.nan_to_num(np.diff(rows, axis=0))
    bend = steps[1:-1] - 0.5 * (steps[:-2] + steps[2:])
    size = np.sqrt(np.mean(bend * bend, axis=1))
    of_block = np.arange(2, len(size) + 2) % BLOCK == 0
    usual = np.where(of_block, np.median(size[of_block]), np.median(size[~of_block]))
    size /= np.maximum(usual, MIN_STEP_GREY)
    row = BORDER + int(np.argmax(size[BORDER : len(size) - BORDER]))
    others = np.delete(size, np.s_[max(0, row - FAR) : row + FAR + 1])
    step = steps[row + 1]
    shared = np.abs(steps[[row, row + 2]] @ step).max() / (step @ step + MIN_STEP_GREY)
    torn = size[row] > max(STEP, ALONE * float(others.max(initial=0.0))) and shared < SHARED
    return row + 2 if torn else None


def _grey(frame: FrameChange) -> Picture:
    """Return the change of grey (H, W, 3) of a frame since the reference, marks filled."""
    before = frame.reference.reference
    if before.marks is None:
        return np.asarray(cv2.subtract(frame.rgb, before.rgb, dtype=cv2.CV_32F))
    return np.dstack([*(frame.changes / frame.reference.maps.scale)])
