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
from tactilevision.photometric.reference import Reference
from tactilevision.records.measured import Bytes, Picture
from tactilevision.records.rig import Sensor

ACROSS = 32  # blocks across the picture
STEP = 6  # times the median over rows: whole real pictures that stand alone reach 4.2
ALONE = 2  # times the step of any row farther than FAR: whole real pictures reach 1.7
BORDER = 8  # rows along the border in which no tear is sought
FAR = 4  # rows next to a tear that its compression may disturb
SHARED = 0.5  # of the step, in the next rows: interpolation of a rectified picture leaves .17, compression more
MOST = (2**16 - 1) // 255  # pixels of a block in a row, whose sum is a number of 16 bits
MIN_STEP_GREY = 0.1  # grey levels: least median step, of rounding


class TearCheck:
    """Finds torn pictures of one sensor; what only its rectification and reference determine is computed once."""

    def __init__(self, sensor: Sensor) -> None:
        rows, columns = np.indices((sensor.height_px, sensor.width_px))
        x, y = (np.rint(one.ravel()).astype(np.int32).clip(0) for one in sensor.rectification or (columns, rows))
        places = y * ACROSS + x * ACROSS // (x.max() + 1)
        ones, size = np.ones(places.size, np.uint64), ((y.max() + 1) * ACROSS, places.size)
        self.sums = sp.csr_array((ones, (places, np.arange(places.size, dtype=np.int32))), shape=size)
        count = np.bincount(places, minlength=size[0]).reshape(-1, ACROSS)
        seen = (count > 0) & (count <= MOST)
        self.count, self.seen = np.maximum(count, 1).astype(np.float32), (seen[1:] & seen[:-1]).astype(np.float32)
        self.before: tuple[Reference, Picture] | None = None

    def __call__(self, frame: FrameChange) -> int | None:
        """Return the first row of the raw picture below a tear; None for a whole picture."""
        before = frame.reference.reference
        if before.marks is not None:
            return self.row_below(self.means(frame.changes / frame.reference.maps.scale))
        if self.before is None or self.before[0] is not before:
            self.before = before, self.means(before.rgb.transpose(2, 0, 1))
        change = self.frame_means(frame.rgb)
        change -= self.before[1]
        return self.row_below(change)

    def means(self, planes: Picture) -> Picture:
        """Return the means (3, rows, ACROSS) of a rectified picture (3, H, W) in rows of the raw one."""
        sums = np.stack([self.sums @ one.ravel() for one in planes]).reshape(3, -1, ACROSS)
        return np.asarray(sums / self.count, np.float32)

    def frame_means(self, rgb: Bytes) -> Picture:
        """Return `means` of a frame (H, W, 3), all colours of a pixel in one number of 64 bits."""
        lanes = cv2.cvtColor(rgb, cv2.COLOR_RGB2RGBA).astype(np.uint16).view(np.uint64)
        sums = (self.sums @ lanes.ravel()).view(np.uint16).reshape(-1, ACROSS, 4)
        return np.asarray(np.divide(sums.transpose(2, 0, 1)[:3], self.count, order="C"))

    def row_below(self, change: Picture) -> int | None:
        """Return the first row below a tear by the change (3, rows, ACROSS) of the means since the reference."""
        planes: Picture = np.empty((4, *change.shape[1:]), np.float32)  # the colours, and their mean
        planes[:3], planes[3] = change, (change[0] + change[1] + change[2]) / 3
        steps = planes[:, 1:] - planes[:, :-1]
        steps *= self.seen
        bend = steps[:, :-2] + steps[:, 2:]
        bend *= -0.5
        bend += steps[:, 1:-1]
        bend *= bend
        squares = bend @ np.full(ACROSS, 1 / ACROSS, np.float32)
        size = np.sqrt([squares[:3].mean(axis=0), squares[3]])
        of_block = np.arange(2, size.shape[1] + 2) % BLOCK == 0
        usual = [_middle(size[:, one]) for one in (of_block, ~of_block)]
        size /= np.maximum(np.where(of_block, *usual), MIN_STEP_GREY)
        if size[:, BORDER:-BORDER].max() <= STEP:
            return None
        return _tear_of(steps[:3], size[0]) or _tear_of(steps[3:], size[1])


def _middle(sizes: Picture) -> Picture:
    """Return the median (2, 1) over rows; np.median takes ten times longer."""
    return np.asarray(np.sort(sizes)[:, [sizes.shape[1] // 2]])


def _tear_of(steps: Picture, size: Picture) -> int | None:
    """Return the first row below a tear by the steps (colours, rows, blocks), and E in units of its median."""
    row = BORDER + int(np.argmax(size[BORDER : len(size) - BORDER]))
    others = np.delete(size, np.s_[max(0, row - FAR) : row + FAR + 1])
    if size[row] <= max(STEP, ALONE * float(others.max(initial=0.0))):
        return None
    step = steps[:, row + 1]
    shared = max(abs(float(np.vdot(steps[:, near], step))) for near in (row, row + 2))
    return row + 2 if shared < SHARED * (float(np.vdot(step, step)) + MIN_STEP_GREY) else None
