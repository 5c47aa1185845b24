"""Identify changes in the pictures since their reference, compression included."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.heightmap.poisson import integrate
from tactilevision.photometric.drift import block_means
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.photometric.reference import COLOURS, make_reference
from tactilevision.photometric.storage import load_network
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Array, Bools, Bytes, Floats, Pair, Picture
from tactilevision.records.rig import Sensor
from tactilevision.robust import mad_std
from tactilevision.sensors import may_have_marks

# Changes in the pictures since their reference, by name.
#
# Blocks of the untouched gel are compared with the reference's, as logarithms of grey. Each fault has its own
# pattern in ln(picture/reference):
#
#     channels swapped, mirrored   the reference fits only with its colours or sides exchanged
#     a lamp failed                one channel's fall-off over the picture is weaker than the others'
#     gamma changed                it grows with ln(reference), equally in all channels
#     automatic exposure           one number for all blocks and channels, different in each frame
#     torn gel, dirt               a mark at one place in all frames, or from one on, in all channels
#
# The median over frames represents the untouched gel, so contacts may cover half of them. Lamp drift is excluded;
# `photometric/drift.py` corrects it.

BLOCKS = (16, 12)  # across and down: too coarse for markers and noise
FINE_BLOCKS = (48, 36)  # across and down, for small marks
DARK_GREY = 4  # added to grey levels, so that black has a logarithm
MIN_CHANGE = 0.08  # ln of grey: lamps that drift, and contacts, change less
BETTER = 0.6  # share of the change, or of the curl, that remains after the correct exchange
FAILED = 0.75  # share that a channel keeps over that of the others: seven real sets keep .976, single frames .934
MIN_FALL = 0.1  # of a channel's brightness, from darker to brighter half; else brightness itself is used
LEAST_KEPT = 0.01  # share of a channel that is dark
GAMMA_CHANGE = 0.12  # of the exponent: a camera's own curve keeps it within .05
GAMMA_SPREAD = 0.15  # ln of grey, deviation over the picture: less shows no exponent
EXPOSURE = 0.05  # ln of grey between frames: lamps flicker by less
ALIKE = 0.25  # of the exposure's change: the most by which channels and places may differ in it
MIN_FRAMES = 3  # frames from which changes between them are determined
MIN_DARK = 2  # frames with a lamp out: one alone may be a contact that covers it
MARK = 0.2  # ln of grey of a mark: dust and grain stay below it
MARK_SIGMA = 8  # deviations of all blocks at which a mark is significant
MARK_BLOCKS = 4  # fine blocks that a mark covers: one may be a dead pixel or a hair
MARK_WIDTH = 8  # fine blocks, sigma: wider changes are the light's
MARK_EDGE = 2  # excluded fine blocks along the border
SIDES: dict[str, Callable[[Array], Array]] = {
    "": lambda a: a,
    "mirrored left to right": lambda a: a[:, ::-1],
    "mirrored top to bottom": lambda a: a[::-1],
    "turned by 180 degrees": lambda a: a[::-1, ::-1],
}  # names of exchanged sides, and the exchange


@dataclass(frozen=True, slots=True)
class SceneFault:
    """A change, in a sentence; `spoils`: it makes depths false; `dims`: a lamp's light is missing."""

    sentence: str
    spoils: bool
    dims: bool = False


def scene_faults(
    reference: Array, pictures: Sequence[Bytes], *, names: Sequence[str] = ()
) -> tuple[SceneFault, ...]:
    """Return the changes in rectified `pictures` (H, W, 3) since the `reference` (H, W, 3), both in grey levels.

    They are in the order of time and have `names`; without names they are numbered. Empty where nothing changed,
    and where none has the reference's shape.
    """
    called = names or [f"number {k + 1}" for k in range(len(pictures))]
    names = [name for name, rgb in zip(called, pictures, strict=True) if rgb.shape == reference.shape]
    pictures = [rgb for rgb in pictures if rgb.shape == reference.shape]
    if not pictures:
        return ()
    before, change = _changes(reference, pictures)
    if exchange := exchanged(before, before + np.median(change, axis=0)):
        told = (
            f"the frames {exchange} against the untouched reference: read both in the same way; depths are false"
        )
        return (SceneFault(told, spoils=True),)
    kept = _kept(before, change)
    dark = "" if _other_everywhere(change) else _failed_lamp(kept)
    spoiling = dark or _gamma(before, change)
    others = ("" if spoiling else _failed_later(kept), _exposure(change), _mark(reference, pictures, names))
    found = [SceneFault(spoiling, spoils=True, dims=bool(dark))] if spoiling else []
    return (*found, *(SceneFault(said, spoils=False) for said in others if said))


def check_order(reference: Array, pictures: Sequence[Bytes]) -> None:
    """Raise InputError where ball `pictures` and the `reference`, all (H, W, 3) in grey levels, have sides or
    colours exchanged.
    """
    before, change = _changes(reference, pictures)
    if exchange := exchanged(before, before + np.median(change, axis=0)):
        raise InputError(
            f"the ball pictures {exchange} against the untouched gel's",
            where="reference/ball",
            remedy="Save both in the same way: taken by one program, sides and colours as they came.",
        )


def able_to_renew(reference: Array, pictures: Sequence[Bytes]) -> list[Bytes]:
    """Return the rectified `pictures` (H, W, 3), in grey, that may renew the `reference` (H, W, 3): without false
    depths.

    If there are none, return those that lack a lamp's light: slopes are then read from the remaining light.
    """
    faults = [scene_faults(reference, [rgb]) for rgb in pictures]
    sound = [rgb for rgb, found in zip(pictures, faults, strict=True) if not any(one.spoils for one in found)]
    return sound or [rgb for rgb, found in zip(pictures, faults, strict=True) if any(one.dims for one in found)]


def _changes(reference: Array, pictures: Sequence[Bytes]) -> tuple[Floats, Floats]:
    """Return ln of grey of the `reference` in BLOCKS, and each picture's difference from it."""
    before = log_blocks(reference, BLOCKS)
    return before, np.stack([log_blocks(rgb, BLOCKS) for rgb in pictures]) - before


def log_blocks(rgb: npt.NDArray[np.generic], size: tuple[int, int]) -> Floats:
    """Return ln of mean grey (rows, columns, 3) in `size` blocks (across, down) of a picture (H, W, 3)."""
    return np.asarray(np.log(block_means(rgb, size).astype(np.float64) + DARK_GREY))


def exchanged(before: Floats, now: Floats) -> str:
    """Return the exchange of sides or colours between two lights, ln of grey (rows, columns, 3); "" for none."""
    if (plain := spread(now - before)) < MIN_CHANGE:
        return ""
    found = {}
    for side, turn in SIDES.items():
        for order in permutations(range(3)):
            found[side, order] = spread(turn(now)[..., list(order)] - before)
    best = min(found, key=lambda key: found[key])
    if found[best] > BETTER * plain:
        return ""
    side, order = best
    swapped = "" if order == (0, 1, 2) else "have red and blue swapped (BGR for RGB)"
    if order not in ((0, 1, 2), (2, 1, 0)):
        swapped = f"have their channels in the order {', '.join(COLOURS[k] for k in order)}"
    return " and ".join(part for part in (f"are {side}" if side else "", swapped) if part)


def spread(change: Floats) -> float:
    """Return the spread of a change (h, w, ...), ln of grey, without NaN: its median, as of a normal deviation."""
    known = change[np.isfinite(change)]
    return mad_std(known) if known.size else float("inf")


def _kept(before: Floats, change: Floats) -> Floats:
    """Return ln of the share that each frame (frames, 3) keeps of a channel's light, by its fall-off over the
    picture.

    It is the median slope of brightness over the reference's, from darker to brighter blocks, independent of
    uniform stray light. For a channel without fall-off it is the brightness ratio.
    """
    grey, now = np.exp(before).reshape(-1, 3), np.exp(before + change).reshape(len(change), -1, 3)
    order, half, channels = np.argsort(grey, axis=0), len(grey) // 2, np.arange(3)
    low, high = order[:half], order[-half:]
    run = grey[high, channels] - grey[low, channels]
    slopes = (now[:, high, channels] - now[:, low, channels]) / np.maximum(run, np.finfo(float).tiny)
    falls = np.median(run, axis=0) > MIN_FALL * np.median(grey, axis=0)
    by_fall = np.log(np.maximum(np.median(slopes, axis=1), LEAST_KEPT))
    return np.where(falls, by_fall, np.median(change, axis=(1, 2)))


def _other_everywhere(change: Floats) -> bool:
    """Return whether two channels or more have another pattern, which no single lamp explains."""
    usual = np.median(change, axis=0)
    return sorted(spread(channel - np.median(channel)) for channel in np.moveaxis(usual, 2, 0))[1] > MIN_CHANGE


def _failed_lamp(kept: Floats) -> str:
    grey = np.median(kept, axis=0)
    darkest = int(np.argmin(grey))
    others = float(np.delete(grey, darkest).max())
    share = float(np.exp(grey[darkest] - others))
    if share > FAILED:
        return ""
    return (
        f"{COLOURS[darkest]} has {share:.2f} of its brightness beside the other colours: a lamp failed, faded or "
        "is covered; depths rest on the other colours. Mend the lamp, or calibrate anew"
    )


def _failed_later(kept: Floats) -> str:
    """Return `_failed_lamp` of the frames that lack one colour; a contact brightens one where another darkens."""
    lost = np.sort(kept, axis=1)[:, 1] + np.log(FAILED)  # compared with the nearer one of the other colours
    dark = (kept < np.minimum(lost, np.log(FAILED))[:, None]).any(axis=1)
    which = np.argmin(kept, axis=1)
    dark &= which == np.argmax(np.bincount(which[dark], minlength=3))
    if np.count_nonzero(dark) < MIN_DARK or not _failed_lamp(kept[dark]):
        return ""
    return f"in {np.count_nonzero(dark)} of {len(kept)} frames looked at, {_failed_lamp(kept[dark])}"


def _gamma(before: Floats, change: Floats) -> str:
    x, y = before.ravel(), np.median(change, axis=0).ravel()
    x = x - np.median(x)
    if mad_std(x) < GAMMA_SPREAD:
        return ""
    runs, rises = np.subtract.outer(x, x), np.subtract.outer(y, y)
    slope = float(np.median(rises[runs > 0] / runs[runs > 0]))  # Theil-Sen estimator
    if abs(slope) < GAMMA_CHANGE:
        return ""
    from scipy.stats import theilslopes  # for its interval: the import takes a second

    _, offset, low, high = theilslopes(y, x, alpha=0.99)
    left = mad_std(y - slope * x - offset)
    if low * high <= 0 or left > BETTER * mad_std(y):
        return ""
    return (
        f"brightness goes with the reference's to the power {1 + slope:.2f}: the camera's gamma or contrast was "
        "changed since; set it back, or calibrate anew"
    )


def _exposure(change: Floats) -> str:
    if len(change) < MIN_FRAMES:
        return ""
    frames = np.median(change, axis=(1, 2))
    common = frames.mean(axis=1)
    swing, apart = float(np.ptp(common)), float(np.ptp(frames - common[:, None], axis=0).max())
    by_place = change[np.argmax(common)] - change[np.argmin(common)]
    if swing < EXPOSURE or max(apart, mad_std(by_place)) > ALIKE * swing:
        return ""
    return (
        f"brightness differs by {100 * np.expm1(swing):.0f} % between frames, in all colours alike: exposure on "
        "automatic, stray light or an unsteady lamp supply? Fix what changes"
    )


def _mark(reference: Array, pictures: Sequence[Bytes], names: Sequence[str]) -> str:
    """Return a mark that all frames and channels show at one place from some frame on, and the reference does not.

    A contact makes some channels brighter and others darker; a mark changes all equally.
    """
    if len(pictures) < MIN_FRAMES:
        return ""
    before = log_blocks(reference, FINE_BLOCKS)
    changes = [log_blocks(rgb, FINE_BLOCKS) - before for rgb in pictures]
    detail = np.stack([change - cv2.GaussianBlur(change, (0, 0), MARK_WIDTH) for change in changes])
    limit = max(MARK, MARK_SIGMA * mad_std(np.median(detail, axis=(0, 3))))
    darker, brighter = ((sign * detail).min(axis=3) for sign in (-1, 1))  # in all channels, by at least
    for first in range(len(pictures) - MIN_FRAMES + 1):
        lasting = np.maximum(darker[first:].min(axis=0), brighter[first:].min(axis=0))
        if (at := _marked(lasting > limit)) is not None:
            x, y = ((k + 0.5) * n / m for k, n, m in zip(at, reference.shape[1::-1], FINE_BLOCKS, strict=True))
            which = "all frames" if first == 0 else f"all frames looked at from {names[first]} on"
            return (
                f"{which} show a mark near ({x:.0f}, {y:.0f}) px that the reference has not: torn gel or dirt? "
                "Clean it; else take a new reference, or a new gel"
            )
    return ""


def _marked(seen: Bools) -> tuple[float, float] | None:
    """Return the centre (column, row) of a mark in differing fine blocks `seen` (rows, columns); or None."""
    count, patches, _, centres = cv2.connectedComponentsWithStats(seen.astype(np.uint8))
    for number in range(1, count):
        column, row = centres[number]
        inside = MARK_EDGE <= column < FINE_BLOCKS[0] - MARK_EDGE and MARK_EDGE <= row < FINE_BLOCKS[1] - MARK_EDGE
        if inside and np.count_nonzero(patches == number) >= MARK_BLOCKS:
            return float(column), float(row)
    return None


# Do pictures have the orientation and colour order of a ready network, neither mirrored nor red and blue swapped?
#
# Slopes of a surface have no curl. Of the squared slopes that a network reads, the best surface leaves .04 to .21
# unexplained on nine real sensors, and .30 to .69 with red and blue exchanged or the picture mirrored. On
# untouched gel there is no difference. With symmetric lamps, one exchange compensates the other. A picture rotated
# by 180 degrees only changes the sign.

FRAMES_FOR_ORDER = 6  # number of frames, spread over the recording
MAX_CURL = 0.4  # of squared slopes: nine real sensors .04 to .21, simulated lights of other sensors .5 to .9
MIN_PLACES = 4  # contacts that determine a light without a network
BLUR_PX = 2.0  # sigma: noise of single pixels is half curl
EXCHANGES: dict[str, Callable[[Bytes], Bytes]] = {
    "red and blue exchanged (BGR for RGB)": lambda rgb: rgb[..., ::-1],
    "the picture mirrored": lambda rgb: rgb[:, ::-1],
}


def order_warnings(
    path: Path, flats: Sequence[Bytes], frames: Sequence[Bytes], *, sensor: Sensor
) -> tuple[str, ...]:
    """Return a warning where slopes of `frames` by the network at `path` fit a surface far better if exchanged.

    `flats` and `frames` are rectified pictures (H, W, 3).
    """

    def curl(exchange: Callable[[Bytes], Bytes]) -> float:
        untouched, seen = ([np.ascontiguousarray(exchange(rgb)) for rgb in many] for many in (flats, frames))
        reference = make_reference(untouched, may_have_marks=may_have_marks(sensor))
        return curl_share(load_network(path, reference), seen, sensor.mm_per_px)

    plain = curl(lambda rgb: rgb)
    shares = {name: curl(exchange) for name, exchange in EXCHANGES.items()}
    better = [name for name, share in shares.items() if share < BETTER * plain]
    if not better:
        return ()
    return (
        f"as they are, the frames show no surface to the ready network for {sensor.kind} ({100 * plain:.0f} % of "
        f"the slopes is curl); with {' or '.join(better)} they do ({100 * min(shares.values()):.0f} %). Save "
        "frames and reference as the maker's software shows them; depths are false",
    )


def check_surface(method: CalibratedMethod, pressed: Sequence[Bytes], *, sensor: Sensor, where: Path) -> None:
    """Raise InputError where the slopes that a ready network reads of contacts belong to no surface.

    `pressed` are rectified pictures (H, W, 3) with a contact; without one noise alone has curl.
    """
    share = curl_share(method, pressed, sensor.mm_per_px)
    if share > MAX_CURL:
        raise InputError(
            f"the light is not that of a usual {sensor.kind}, whose network reads no surface here",
            where=where,
            value=f"{100 * share:.0f} % of the slopes is curl",
            remedy="Press balls to calibrate the light; or name the sensor custom, and press something round at "
            f"{MIN_PLACES} places or more.",
        )


def curl_share(method: PhotometricMethod, frames: Sequence[Bytes], mm_per_px: Pair) -> float:
    """Return the share, 0 to 1, of squared slopes in rectified `frames` (H, W, 3) with curl; NaN if none."""
    left = whole = 0.0
    for rgb in frames:
        with suppress(InputError):
            read = method.slopes(rgb)
            known = 1.0 if read.valid is None else read.valid
            p, q = (cv2.GaussianBlur(slope * known, (0, 0), BLUR_PX) for slope in (read.dz_dx, read.dz_dy))
            down, along = np.gradient(integrate(SlopeMap(p, q), mm_per_px), *mm_per_px[::-1])
            left += float(np.sum((p - along) ** 2 + (q - down) ** 2))
            whole += float(np.sum(p**2 + q**2))
    return left / whole if whole else float("nan")


# Compression strength of pictures, from the steps between blocks of JPEG and video codes.

BLOCK = 8  # px of a block of JPEG and of most video codes


def blocks_grey(rgb: Bytes) -> float:
    """Return the excess grey step across blocks of a picture (H, W, 3) over that within; at least 0."""
    picture = rgb.astype(np.float32)
    return max(0.0, _across(picture), _across(picture.transpose(1, 0, 2)))


def _across(picture: Picture) -> float:
    steps = np.abs(np.diff(picture, axis=1)).mean(axis=(0, 2))
    border = np.arange(1, len(steps) + 1) % BLOCK == 0
    return float(np.median(steps[border]) - np.median(steps[~border])) if border.any() else 0.0
