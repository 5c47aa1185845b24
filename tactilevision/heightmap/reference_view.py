"""Check that pictures have three lights and their reference's view; register a reference of another view.

A driver that crops, scales or flips its stream makes pictures of another view than a reference from the raw one.
The texture of gel and camera is common to both only in one view, without regard to the light:

    c(0) = sum_x g_0(x) g(x)        g: normalised detail (reference_match.py), in deviations of c(d) over all d

Where it is not, the light decides, in ln of grey of blocks, of which the median over pictures is that of untouched
gel: with the scale s and shift t that minimise the mean of |ln I(x) - ln I_0(s x + t) - gain|, limited to MAX_OFF,
a crop of the same scene fits, and a reference of another unit does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.heightmap.reference_match import SHIFT_SIGMA, image_shift, shared_detail
from tactilevision.heightmap.scene_faults import MIN_CHANGE as CHANGED, SIDES, exchanged, log_blocks, spread
from tactilevision.photometric.reference import SATURATED
from tactilevision.recording import layout
from tactilevision.records.measured import Array, Bools, Bytes, Floats, Picture

BLOCKS = (48, 36)  # across and down: coarse enough to average out marks and noise
FINE = (192, 144)  # across and down, for the last tenth of a pixel
MIN_PICTURES = 3  # fewer may all show a contact over most of the gel
SAMPLED = 4  # pictures whose texture is compared, evenly spaced
ALIKE = 0.9  # correlation of the colours' changes, each pair: white light .975 and more, coloured at most .43
MAX_CHROMA = 0.06  # ln of grey, spread of the reference's hue: white light .012 at most, coloured .106 and more
LEAST_SHOWN = 0.004  # ln of grey, rms: less is noise, in which JPEG makes colours alike
MIN_CHANGE = 0.02  # ln of grey, spread: a reference that differs by less needs no texture to be of the view
MAX_OFF = 0.5  # ln of grey of a block that a contact may be off by and still count
STARTS = (-0.4, -0.2, 0.0, 0.2, 0.4)  # ln of the scales that the search begins with
STEPS = (0.1, 0.15, 0.15)  # first steps of the search: ln of scale, shifts in half pictures
FARTHEST = 0.7  # ln of scale, a factor of 2, and shift in half pictures: the farthest view that is sought
MIN_COVERED = 0.5  # of the frames' view that a registered reference covers
DARK = 0.1  # of the reference's grey: frames below it are black, and show no view
REGISTERED = 0.5  # of the difference that remains: crops of seven real sets .38 at most, other units .61 and more
MAX_LEFT = 0.04  # ln of grey, of one view: real presses against their reference .034, other units .045 and more


@dataclass(frozen=True, slots=True)
class Registered:
    """Pictures of the untouched gel in the view of the frames.

    `covered` (H, W) by the reference, None for all; elsewhere it is the median of the frames. `note`: what was
    done, in a sentence.
    """

    flats: Sequence[Bytes]
    covered: Bools | None = None
    note: str = ""


def shown(pictures: Sequence[Bytes], flats: Sequence[Bytes]) -> list[Bytes]:
    """Return the `pictures` (H, W, 3), grey, that show a view: not black, white, nor the `flats` themselves."""
    dark = DARK * float(np.mean(flats[0]))
    lit = [rgb for rgb in pictures if dark < rgb.mean() < SATURATED]
    return [rgb for rgb in lit if not any(np.array_equal(rgb, flat) for flat in flats)]


def check_three_lights(reference: Array, pictures: Sequence[Bytes]) -> None:
    """Raise InputError where `pictures` and their `reference`, (H, W, 3) in grey levels, are lit by one light.

    All colours then have one pattern in the reference, and change alike under a contact.
    """
    if not has_one_hue(reference):
        return
    before = log_blocks(reference, BLOCKS)
    centred = [_centred(log_blocks(rgb, BLOCKS) - before) for rgb in pictures if rgb.shape == reference.shape]
    change = np.concatenate([np.zeros((1, 3)), *(one.reshape(-1, 3) for one in centred)])
    if float(change.std()) < LEAST_SHOWN:
        return
    alike = float(np.corrcoef(change.T).min())
    if alike > ALIKE:
        raise InputError(
            f"the three colours change alike (correlation {alike:.3f}), so there is one light, and slopes need "
            "three, of different colours and directions",
            where="frames",
            remedy="Sensors under white light (DTact, 9DTact) read depth from brightness, which is not supported.",
        )


def has_one_hue(reference: Array) -> bool:
    """Return whether a reference (H, W, 3), in grey levels, has one hue all over, as under one light."""
    pattern = _centred(log_blocks(reference, BLOCKS))
    return float((pattern - pattern.mean(axis=2, keepdims=True)).std()) < MAX_CHROMA


def in_view_of(flats: Sequence[Bytes], pictures: Sequence[Bytes]) -> bool:
    """Return whether `pictures` are in the view of `flats`, all (H, W, 3), by texture, or else by light."""
    reference, some = _mean(flats), _spaced(pictures, SAMPLED)
    if any(rgb.shape != reference.shape for rgb in some):
        return True
    light, now = log_blocks(reference, BLOCKS), _usual(pictures)
    if exchanged(light, now):
        return False
    if any(shared_detail(reference, rgb) > SHIFT_SIGMA for rgb in some):
        return True
    # a camera that was knocked keeps its view, and its maps are flagged; marks of another gel may seem moved, too
    moved = np.array(image_shift(reference, some) or (0.0, 0.0)) / reference.shape[1::-1]
    alike = MAX_LEFT if moved.any() else MIN_CHANGE
    return spread(_centred(now - _warped(light, np.array([0.0, *(-2 * moved)])))) < alike


def register(flats: Sequence[Bytes], pictures: Sequence[Bytes]) -> Registered:
    """Return `flats` (H, W, 3), not `in_view_of` the `pictures`, registered to them, all before rectification.

    Unchanged where they differ little, or where the pictures are too few to say. Raises InputError for flats that
    are flipped, and for those of another view.
    """
    reference = _mean(flats)
    light, now = log_blocks(reference, BLOCKS), _usual(pictures)
    if flip := exchanged(light, now) or _flipped(reference, pictures):
        raise _other_view(f"the frames {flip} against it", "Save both in the same way.")
    before = spread(_centred(now - light))
    fine = np.asarray(np.median([log_blocks(rgb, FINE) for rgb in _spaced(pictures, MIN_PICTURES)], axis=0))
    coarse = [_search(light, now, np.array([start, 0.0, 0.0])) for start in STARTS]
    place = _search(log_blocks(reference, FINE), fine, min(coarse, key=partial(_off, before=light, now=now)), 0.02)
    left = spread(_centred(now - _warped(light, place)))
    if left < min(REGISTERED * before, CHANGED):
        return _registered(flats, pictures, place)
    if before < MAX_LEFT or len(pictures) < MIN_PICTURES:
        return Registered(flats)
    raise _other_view(
        f"its texture is another, and its light differs by {100 * np.expm1(before):.0f} %, at any scale and shift",
        "It may show another crop, place or unit.",
    )


def _other_view(why: str, remedy: str = "") -> InputError:
    return InputError(f"the reference is not of the frames' view: {why}", where=layout.FLATS, remedy=remedy)


def _registered(flats: Sequence[Bytes], pictures: Sequence[Bytes], place: Floats) -> Registered:
    height, width = flats[0].shape[:2]
    matrix, seen = _matrix(place, (width, height)), np.full((height, width), 255, np.uint8)
    inverse = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    covered = np.asarray(cv2.warpAffine(seen, matrix, (width, height), flags=inverse) == 255)
    moved = [cv2.warpAffine(rgb, matrix, (width, height), flags=inverse) for rgb in flats]
    usual = np.median(pictures, axis=0)
    gain = np.median(np.stack(moved)[:, covered], axis=(0, 1)) / np.maximum(np.median(usual[covered], axis=0), 1)
    other = np.clip(np.rint(usual * gain), 0, 255).astype(np.uint8)
    filled = [np.asarray(np.where(covered[..., None], rgb, other), np.uint8) for rgb in moved]
    x, y = place[1] * width / 2, place[2] * height / 2
    note = (
        f"the reference shows another crop than the frames: it is scaled by {np.exp(-place[0]):.3f} and shifted "
        f"by ({-x:+.1f}, {-y:+.1f}) px"
    )
    if covered.all():
        return Registered(filled, None, note)
    note += f"; it covers {100 * covered.mean():.0f} % of it, the rest is invalid"
    return Registered(filled, covered, note)


def _flipped(reference: Picture, pictures: Sequence[Bytes]) -> str:
    """Return how the texture of most `pictures` is turned against the `reference`; "" where none is."""
    some = _spaced(pictures, SAMPLED)
    for name, turn in SIDES.items():
        turned = np.ascontiguousarray(turn(reference))
        if name and any(shared_detail(turned, rgb) > SHIFT_SIGMA for rgb in some):
            return f"are {name}"
    return ""


def _search(before: Floats, now: Floats, start: Floats, step: float = 1.0) -> Floats:
    from scipy.optimize import minimize

    simplex = np.vstack([start, start + step * np.diag(STEPS)])
    options: Any = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-6, "maxfev": 200}
    off = partial(_off, before=before, now=now)
    return np.asarray(minimize(off, start, method="Nelder-Mead", options=options).x)


def _off(place: Floats, before: Floats, now: Floats) -> float:
    if np.abs(place).max() > FARTHEST:
        return 2 * MAX_OFF
    change = now - _warped(before, place)
    known = np.isfinite(change).all(axis=2)
    if known.mean() < MIN_COVERED:
        return 2 * MAX_OFF
    change = change[known] - np.median(change[known], axis=0)
    return float(np.minimum(np.abs(change), MAX_OFF).mean())


def _warped(blocks: Floats, place: Floats) -> Floats:
    """Return blocks (h, w, 3) at s x + t, NaN outside."""
    size = blocks.shape[1::-1]
    flags, nan = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, (np.nan,) * 3
    return np.asarray(cv2.warpAffine(blocks, _matrix(place, size), size, flags=flags, borderValue=nan))


def _matrix(place: Floats, size: tuple[int, int]) -> Floats:
    """Return the matrix (2, 3) from a pixel of the frames to that of the reference, of pictures of `size`."""
    scale = float(np.exp(place[0]))
    middle = [(n - 1) / 2 * (1 - scale) + n / 2 * shift for n, shift in zip(size, place[1:], strict=True)]
    return np.array([[scale, 0.0, middle[0]], [0.0, scale, middle[1]]])


def _mean(flats: Sequence[Bytes]) -> Picture:
    return np.asarray(np.mean(flats, axis=0, dtype=np.float32))


def _usual(pictures: Sequence[Bytes]) -> Floats:
    return np.asarray(np.median([log_blocks(rgb, BLOCKS) for rgb in pictures], axis=0))


def _centred(blocks: Floats) -> Floats:
    return np.asarray(blocks - np.nanmedian(blocks, axis=(0, 1)))


def _spaced(pictures: Sequence[Bytes], count: int) -> list[Bytes]:
    return [
        pictures[k] for k in np.unique(np.linspace(0, len(pictures) - 1, min(count, len(pictures))).astype(int))
    ]
