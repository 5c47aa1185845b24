"""Tangential displacement of the gel's surface since an untouched frame: by texture or by markers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import center_of_mass
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist
from scipy.special import xlogy

from tactilevision.errors import InputError
from tactilevision.photometric.markers import MIN_COUNT, evenly_spaced
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_flats
from tactilevision.records.constants import MICRO, MILLI, TINY
from tactilevision.records.maps import ShearMap
from tactilevision.records.measured import Bools, Bytes, Floats, Pair
from tactilevision.sensors.rectification import rectify

# Dense motion of the ink's texture, invariant to light.
#
# Contact changes the light over millimetres, the ink's grain over tenths: the mean over `GRAIN_PX` pixels is
# subtracted from each channel's logarithm, so a factor of light cancels. Ink darkens all colours equally while
# noise is independent between channels, so their differences give each channel's variance (three-cornered hat),
#
#     2 s_r^2 = V(r - g) + V(r - b) - V(g - b),
#
# so that dark and noisy channels have small weights. The weighted mean is divided by its contrast and tracked by
# OpenCV's inverse-search flow (Kroeger et al., ECCV 2016), both ways. Variance: half the squared difference of the
# flow forth and back, and the residual between the two pictures after warping, over the texture's slope: noise,
# and light that changes too fast to cancel.

GRAIN_PX = 2.0  # px: size of the texture's grains
CONTRAST_PX = 12  # px over which contrast and noise are measured
ROUND_TRIP_PX = 1.0  # px: largest error of the flow forth and back
MIN_KNOWN = 0.5  # share of the view
TEXTURE_OVER_NOISE = 1.5  # least ratio of texture to noise
CORRELATION_PX = 8  # px: patch of the flow
BLOCK_PX = 4  # px: blocks over which a frame without texture is told quickly
CLEARLY = 0.05  # share of the view: ten times what blocks err in it
SUM = np.ones((1, 3), dtype=np.float32)  # of a pixel's channels
LOGARITHM = np.log1p(np.arange(256, dtype=np.float32))  # of each grey level, plus one
Singles = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Texture:
    """Texture of the untouched gel: `weights` (H, W, 3) of the channels, `pattern` (H, W) of unit contrast,
    `slope` its mean square gradient, `known` (H, W) where it exceeds the noise, `by_blocks` the same two by block.
    """

    weights: Singles
    pattern: Singles
    slope: Singles
    known: Bools
    by_blocks: tuple[Singles, Singles]


def read_texture(before: Bytes) -> Texture:
    """Read the texture of an untouched frame (H, W, 3)."""
    fine = _fine(before)
    variance = _channel_noise(fine)
    weights = np.asarray(1 / variance / (1 / variance).sum(axis=2, keepdims=True), dtype=np.float32)
    pattern, known = _pattern(fine, weights)
    along, down = (cv2.Sobel(pattern, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    slope = _smooth(np.asarray((along**2 + down**2) / 2), CORRELATION_PX)
    by_blocks = _blocks(weights, BLOCK_PX), _blocks(known.astype(np.float32), BLOCK_PX)
    return Texture(weights, pattern, slope, known, by_blocks)


def follow_texture(before: Texture, after: Bytes) -> tuple[Floats, Floats, Bools] | None:
    """Measure the motion (H, W, 2) in px of what was at each pixel of `before`, its standard deviation, and where
    valid.

    None if the texture is below the noise over MIN_KNOWN of either picture: the untouched one is often a mean of
    many, with less noise than one frame.
    """
    fine = _fine(after)
    if _known_by_blocks(before, fine) < MIN_KNOWN - CLEARLY:
        return None
    second, seen = _pattern(fine, before.weights)
    if (before.known & seen).mean() < MIN_KNOWN:
        return None  # under a contact a change of light counts as noise here; the residual decides there
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow.setFinestScale(0)
    flow.setUseSpatialPropagation(True)
    images = [_as_bytes(before.pattern), _as_bytes(second)]
    forth = flow.calc(images[0], images[1], None)
    back = flow.calc(images[1], images[0], None)
    rows, columns = second.shape
    x, y = np.meshgrid(np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32))
    to_x, to_y = x + forth[..., 0], y + forth[..., 1]
    returned = cv2.remap(back, to_x, to_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    warped = cv2.remap(second, to_x, to_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    round_trip = _smooth(((forth + returned) ** 2).mean(axis=2) / 2, CORRELATION_PX)
    residual = _smooth((warped - before.pattern) ** 2, CORRELATION_PX)
    patch = CORRELATION_PX / GRAIN_PX  # independent grains along a side of the flow's patch
    std = np.sqrt(round_trip + residual / (patch**2 * np.maximum(before.slope, TINY)))
    inside = (to_x >= 0) & (to_x <= columns - 1) & (to_y >= 0) & (to_y <= rows - 1)
    valid = np.asarray(before.known & inside & (std < ROUND_TRIP_PX), dtype=np.bool_)
    return forth.astype(np.float64), std.astype(np.float64), valid


def _fine(rgb: Bytes) -> Singles:
    """Return the logarithm of each channel (H, W, 3) without what is coarser than the grain."""
    light = cv2.LUT(rgb, LOGARITHM)
    sharp = cv2.GaussianBlur(light, (0, 0), 0.7)
    return np.asarray(cv2.subtract(sharp, cv2.GaussianBlur(light, (0, 0), GRAIN_PX), sharp))


def _channel_noise(fine: Singles, block: int = 1) -> Singles:
    """Estimate the variance of each channel's own noise (H, W, 3) from the differences between channels."""
    r, g, b = cv2.split(fine)
    rg, rb, gb = (_power(one, block) for one in (r - g, r - b, g - b))
    found = np.stack([rg + rb - gb, rg + gb - rb, rb + gb - rg], axis=2) / 2
    return np.asarray(np.maximum(found, 0.02 * (rg + rb + gb)[..., None]) + TINY)


def _pattern(fine: Singles, weights: Singles) -> tuple[Singles, Bools]:
    """Return the weighted mean (H, W) of unit contrast, and where it exceeds the noise."""
    mean = _weighted(fine, weights)
    noise = _weighted(_channel_noise(fine), weights**2)
    power = _power(mean)
    scale = np.sqrt(np.maximum(power, noise))
    return np.asarray(mean / scale), np.asarray(power > (1 + TEXTURE_OVER_NOISE**2) * noise, dtype=np.bool_)


def _known_by_blocks(before: Texture, fine: Singles) -> float:
    """Return about the share of the view in which texture exceeds the noise of both pictures, in a third of the
    time.
    """
    weights, known = before.by_blocks
    power = _power(_weighted(fine, before.weights), BLOCK_PX)
    noise = _weighted(_channel_noise(fine, BLOCK_PX), weights**2)
    return float((known * (power > (1 + TEXTURE_OVER_NOISE**2) * noise)).mean())


def _weighted(fine: Singles, weights: Singles) -> Singles:
    """Return the weighted sum (H, W) of the channels."""
    return np.asarray(cv2.transform(fine * weights, SUM))


def _power(picture: Singles, block: int = 1) -> Singles:
    """Return the mean square over CONTRAST_PX around each pixel, or each block of pixels."""
    return _smooth(_blocks(picture**2, block), CONTRAST_PX / block)


def _blocks(picture: Singles, block: int) -> Singles:
    """Return means over blocks of so many pixels across."""
    return np.asarray(cv2.resize(picture, None, fx=1 / block, fy=1 / block, interpolation=cv2.INTER_AREA))


def _smooth(picture: npt.NDArray[Any], size_px: float) -> Singles:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), size_px), dtype=np.float32)


def _as_bytes(texture: Singles) -> Bytes:
    return np.asarray(np.clip(128 + 40 * texture, 0, 255), dtype=np.uint8)


# Markers: dark spots on the gel, detected in a frame, tracked into another, and interpolated.
#
# Detection: Otsu's threshold of the darkness -log(I / local mean) of the darkest channel; a connected spot is a
# marker, its place the mean weighted by darkness, which a factor of light does not change. Tracking: a marker is
# predicted to move as its neighbours, starting from those that did not move; a pair counts if each is the other's
# nearest and within `REACH` of the markers' spacing of the prediction. So a motion of many spacings is tracked if
# it changes by less than `REACH` of a spacing from one marker to the next. Interpolation: a thin-plate spline,
# smoothed by generalised cross-validation. Its leave-one-out errors are the standard deviation of the map, of
# localisation and interpolation together.

REACH = 0.4  # of the markers' spacing: beyond a half a neighbour is as near
MAX_ITERATIONS = 12  # rounds of matching
NEIGHBOURS = 6  # markers that predict the motion of one
ROUND_ABOUT = 2.0  # spacings over which errors are averaged


@dataclass(frozen=True, slots=True)
class MarkerMotion:
    """`place_px` (N, 2) of the markers in the first frame, `motion_px` (N, 2), and which were `found` again
    (N,).
    """

    place_px: Floats
    motion_px: Floats
    found: Bools


def find_markers(rgb: Bytes) -> Floats:
    """Find the places (N, 2) in pixels of the markers in a frame (H, W, 3); none if it has no similar spots."""
    dark = darkness(rgb)
    top = max(float(np.percentile(dark, 99.8)), MICRO)
    grey = np.asarray(np.clip(dark / top * 255, 0, 255), dtype=np.uint8)
    _, spots = cv2.threshold(grey, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    count, label, stats, _ = cv2.connectedComponentsWithStats(spots, connectivity=8)
    area = stats[1:, cv2.CC_STAT_AREA].astype(float)
    if count < 2:
        return np.zeros((0, 2))
    usual = float(np.median(area[area >= 4])) if (area >= 4).any() else 0.0
    kept = (area >= max(4, usual / 3)) & (area <= 3 * usual)
    places = np.array(center_of_mass(np.maximum(dark, 0), label, np.arange(1, count)))[:, ::-1]
    left, top = stats[1:, cv2.CC_STAT_LEFT], stats[1:, cv2.CC_STAT_TOP]
    right, low = left + stats[1:, cv2.CC_STAT_WIDTH], top + stats[1:, cv2.CC_STAT_HEIGHT]
    kept &= (left > 0) & (top > 0) & (right < dark.shape[1]) & (low < dark.shape[0])  # not cut by the border
    return np.asarray(places[kept])


def follow_markers(before_px: Floats, after_px: Floats) -> MarkerMotion:
    """Match markers of one frame (N, 2) to those of another (M, 2)."""
    motion = np.zeros_like(before_px)
    found = np.zeros(len(before_px), dtype=bool)
    if len(before_px) < NEIGHBOURS + 1 or len(after_px) == 0:
        return MarkerMotion(before_px, motion, found)
    tree, spacing = KDTree(before_px), _spacing(before_px)
    near = np.asarray(tree.query(before_px, NEIGHBOURS + 1)[1])[:, 1:]
    after = KDTree(after_px)
    for _ in range(MAX_ITERATIONS):
        expected = before_px + motion
        distance, partner = (np.asarray(part) for part in after.query(expected))
        back = np.asarray(KDTree(expected).query(after_px)[1])
        pairs = (distance < REACH * spacing) & (back[partner] == np.arange(len(before_px)))
        seen = np.where(pairs[:, None], after_px[partner] - before_px, 0.0)
        pairs &= _like_neighbours(seen, pairs, near, spacing)
        moved = np.where(pairs[:, None], seen, _from_neighbours(seen, pairs, near, motion))
        settled = np.array_equal(pairs, found) and np.allclose(moved, motion, atol=MILLI)
        motion, found = moved, pairs
        if settled:
            break
    return MarkerMotion(before_px, motion, found)


def spread_motion(motion: MarkerMotion, shape: tuple[int, int], *, step_px: int) -> tuple[Floats, Floats]:
    """Return the motion (H, W, 2) in pixels at every pixel, and its standard deviation (H, W) by cross-validation.

    The deviation at a place is that of the markers around it: near a contact's edge it is greater.
    """
    place, moved = motion.place_px[motion.found], motion.motion_px[motion.found]
    scale, spacing = float(max(shape)), _spacing(place)
    place = place / scale
    kernel, ones = _thin_plate(place, place), np.column_stack([np.ones(len(place)), place])
    smoothing = _smoothing(kernel, ones, moved)
    system = np.block([[kernel + smoothing * np.eye(len(place)), ones], [ones.T, np.zeros((3, 3))]])
    inverse = np.linalg.inv(system)
    weights = inverse @ np.concatenate([moved, np.zeros((3, 2))])
    held_out = weights[: len(place)] / np.diag(inverse)[: len(place), None]  # leave-one-out errors
    rows, columns = (np.arange(0, n + step_px, step_px) for n in shape)
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2) / scale
    bent = _thin_plate(nodes, place) @ weights[:-3]
    plane = np.column_stack([np.ones(len(nodes)), nodes]) @ weights[-3:]
    near = np.exp(-0.5 * cdist(nodes, place, "sqeuclidean") * (scale / (ROUND_ABOUT * spacing)) ** 2) + MICRO
    std = np.sqrt((near @ (held_out**2).mean(axis=1)) / near.sum(axis=1))
    coarse = np.column_stack([bent + plane, std]).reshape(len(rows), len(columns), 3).astype(np.float32)
    x, y = np.meshgrid(np.arange(shape[1], dtype=np.float32), np.arange(shape[0], dtype=np.float32))
    dense = cv2.remap(coarse, x / step_px, y / step_px, cv2.INTER_LINEAR).astype(np.float64)
    return dense[..., :2], dense[..., 2]


def hull(places_px: Floats, shape: tuple[int, int]) -> Bools:
    """Return the mask (H, W) of the pixels between the markers; beyond them nothing is known."""
    mask = np.zeros(shape, dtype=np.uint8)
    points = cv2.convexHull(np.round(places_px).astype(np.int32)).reshape(-1, 2)
    cv2.fillConvexPoly(mask, points, 1)
    return mask.astype(bool)


def darkness(rgb: Bytes) -> Floats:
    """Return -log of the lightest channel's ratio to its mean round about (H, W).

    A mark is dark in all colours, a shade is not.
    """
    light = np.log1p(rgb.max(axis=2).astype(np.float32))
    wide = max(3, rgb.shape[0] / 20)
    around = cv2.GaussianBlur(light, (0, 0), wide)
    return np.asarray(cv2.GaussianBlur(around - light, (0, 0), 0.8), dtype=np.float64)


def _spacing(places: Floats) -> float:
    return float(np.median(np.asarray(KDTree(places).query(places, 2)[0])[:, 1]))


def _like_neighbours(seen: Floats, pairs: Bools, near: np.ndarray, spacing: float) -> Bools:
    """Return whether each pair moved as its matched neighbours did, to `REACH` of a spacing; a lone pair is
    kept."""
    around = np.where(pairs[near][:, :, None], seen[near], np.nan)
    count = pairs[near].sum(axis=1)
    middle = np.zeros_like(seen)
    some = count > 0
    middle[some] = np.nanmedian(around[some], axis=1)
    return np.asarray((count < 2) | (np.hypot(*(seen - middle).T) < REACH * spacing))


def _from_neighbours(seen: Floats, pairs: Bools, near: np.ndarray, motion: Floats) -> Floats:
    """Predict each marker's motion from matched neighbours; without any, keep the earlier estimate."""
    weight = pairs[near].astype(float)
    total = weight.sum(axis=1, keepdims=True)
    mean = (weight[:, :, None] * seen[near]).sum(axis=1) / np.maximum(total, 1)
    return np.where(total > 0, mean, motion)


def _thin_plate(a: Floats, b: Floats) -> Floats:
    square = cdist(a, b, "sqeuclidean")
    return np.asarray(xlogy(square, square) / 2)


def _smoothing(kernel: Floats, ones: Floats, moved: Floats) -> float:
    """Choose the weight against bending by generalised cross-validation over powers of four."""
    q = np.linalg.qr(ones, mode="complete")[0][:, 3:]
    values, vectors = np.linalg.eigh(q.T @ kernel @ q)
    part = vectors.T @ (q.T @ moved)
    values = np.maximum(values, 0)
    weights = 4.0 ** np.arange(-18, -4)
    shares = weights[:, None] / (values + weights[:, None])
    scores = ((shares[:, :, None] * part) ** 2).sum(axis=(1, 2)) / shares.sum(axis=1) ** 2
    return float(weights[scores.argmin()])


# Displacement by markers or by texture, compared with an untouched frame that is read once.

STEP_PX = 4  # px: grid of the interpolated motion; markers are much farther apart
LOST = "markers lost"
NOTHING_TO_FOLLOW = "the gel shows neither markers nor texture to follow"


@dataclass(frozen=True, slots=True)
class Untouched:
    """The untouched gel as the reference: its `markers` (N, 2) in pixels, its `texture`, or neither."""

    shape: tuple[int, int]
    mm_per_px: Pair
    markers: Floats | None = None
    texture: Texture | None = None

    @property
    def shows(self) -> bool:
        """Whether there is anything to track."""
        return self.markers is not None or self.texture is not None

    def shear(self, frame: Bytes) -> ShearMap:
        """Measure the displacement since then of what a rectified frame (H, W, 3) shows, at places of the
        untouched one.

        Without markers or texture no pixel is valid, and the map is flagged, as it is if more than a tenth of the
        markers is lost. Raises InputError for a frame of another size.
        """
        if frame.shape != (*self.shape, 3):
            raise InputError(
                "the two frames differ in size, (H, W, 3)",
                where="Untouched.shear",
                value=(self.shape, frame.shape),
            )
        if self.markers is not None:
            return self._by_markers(self.markers, frame)
        if self.texture is None or (followed := follow_texture(self.texture, frame)) is None:
            return self._unknown((NOTHING_TO_FOLLOW,))
        # an error by the light of a contact is common to all of it
        return self._map(*followed, np.inf)

    def _by_markers(self, places: Floats, frame: Bytes) -> ShearMap:
        motion = follow_markers(places, find_markers(frame))
        found = int(motion.found.sum())
        flags = (f"{LOST}: {len(places) - found} of {len(places)}",) if found < 0.9 * len(places) else ()
        if found < MIN_COUNT:
            return self._unknown(flags)
        dense, std_px = spread_motion(motion, self.shape, step_px=STEP_PX)
        spacing = float(np.sqrt(np.prod(np.ptp(places, axis=0)) / len(places)))
        valid = hull(places[motion.found], self.shape)
        return self._map(dense, std_px, valid, spacing, flags)

    def _map(
        self, motion_px: Floats, std_px: Floats, valid: Bools, correlation_px: float, flags: tuple[str, ...] = ()
    ) -> ShearMap:
        u_x_mm, u_y_mm = (motion_px[..., axis] * step for axis, step in enumerate(self.mm_per_px))
        std_mm = std_px * float(np.mean(self.mm_per_px))
        return ShearMap(u_x_mm, u_y_mm, valid, self.mm_per_px, std_mm, correlation_px, flags)

    def _unknown(self, flags: tuple[str, ...]) -> ShearMap:
        unknown = np.zeros(self.shape)
        return ShearMap(unknown, unknown, np.zeros(self.shape, dtype=bool), self.mm_per_px, flags=flags)


def untouched_frame(recording: Recording) -> Bytes | None:
    """Return the first reference picture of the untouched gel, rectified; None if the recording has none."""
    flats = read_flats(replace(recording, flats=recording.flats[:1]))
    return rectify(recording.sensor, flats[0]) if flats else None


def read_untouched(reference: Bytes, mm_per_px: Pair, *, markers: bool | None = None) -> Untouched:
    """Read a rectified frame (H, W, 3) of the untouched gel.

    `markers` True or False: whether the gel has marks; None: detected. Without marks the texture of the ink is
    tracked, if it exceeds the noise over half of the view. Raises InputError if `markers` is True and too few are
    found.
    """
    if reference.ndim != 3 or reference.shape[2] != 3:
        raise InputError("a frame is (H, W, 3)", where="read_untouched", value=reference.shape)
    shape = (reference.shape[0], reference.shape[1])
    places = find_markers(reference) if markers is not False else np.zeros((0, 2))
    if markers and len(places) < MIN_COUNT:
        raise InputError(
            "too few markers in the reference frame to follow the gel",
            where="read_untouched",
            value=len(places),
            remedy="Set markers=False to follow the ink's texture.",
        )
    if markers or (markers is None and evenly_spaced(places)):
        return Untouched(shape, mm_per_px, markers=places)
    texture = read_texture(reference)
    return Untouched(shape, mm_per_px, texture=texture if texture.known.mean() >= MIN_KNOWN else None)
