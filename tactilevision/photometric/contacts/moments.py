"""What a contact of unknown shape asks of a colour law: its slopes are those of a surface.

Slopes p, q that belong to a height have no curl. Against any test function v that vanishes within the picture,

    integral of  p dv/dy - q dv/dx  = 0

which needs no derivative of noisy slopes, and is linear in the coefficients of a law that is. v are Gaussians
about the contact, and Gaussians times x or y from their middle; widths and places go with the contact's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric.ball.detection import first_guess
from tactilevision.photometric.illumination.colour_change import Planes
from tactilevision.photometric.methods.polynomial import POWERS, PRODUCTS
from tactilevision.records import Bools, Floats

WIDTHS = (0.2, 0.35, 0.6)  # of a Gaussian, in radii of the contact; twice as wide is .1 to 1 degree worse
SPOKES = 6  # Gaussians round the one in the middle
APART = 1.6  # widths from the middle to those round it
FARTHEST = 1.4  # contact radii from the middle: beyond there is little slope
SUPPORT = 2.5  # widths after which a Gaussian counts for nothing
REACH = 2.5  # contact radii that a window reaches
MAX_PIXELS = 6000  # of a window; moments of more are no quieter
MAX_INVALID = 0.01  # of a test function's weight where the colours tell nothing
MIN_RADIUS_PX = 6.0  # px; a smaller contact is mostly blur
MIN_EQUATIONS = 6  # equations; a contact at the border leaves fewer
SAMPLES = 300  # pixels of a contact that stand for its slopes
# highest power of place for one colour and for products of two; 2 and 1 are .1 to .9 degrees worse on D, F and G
PLACE_ORDER = {1: 4, 2: 1}
TERMS = tuple(
    (k, m)
    for k, product in enumerate(PRODUCTS)
    for m, power in enumerate(POWERS)
    if sum(power) <= PLACE_ORDER.get(len(product), -1)
)  # colour product and power of place of each coefficient of one slope


@dataclass(frozen=True, slots=True)
class Contact:
    """`equations` (E, 2 K) for the coefficients of p, then of q; `samples` (M, K) of the terms in the contact.

    `change` (M, 3) and `place` (M, 2) of the samples; `outward` (M, 2) from the contact's middle, in its radii.
    """

    equations: Floats
    samples: Floats
    change: Floats
    place: Floats
    outward: Floats


def contact_of(change: Planes, valid: Bools, rng: np.random.Generator) -> Contact | None:
    """The contact of a frame by its relative change (3, H, W), where it is `valid`, a mask (H, W); or None."""
    try:
        x, y, radius = first_guess(np.ascontiguousarray(change.transpose(1, 2, 0)), valid)
    except InputError:
        return None
    if radius < MIN_RADIUS_PX:
        return None
    (across, down), u, place, known = _window(change, valid, x, y, radius)
    tests = np.array(list(_tests(across, down, known, edges=_edges(valid.shape, x, y, radius))))
    inside = np.flatnonzero((np.hypot(across, down) < 1.0) & known)
    if len(tests) < MIN_EQUATIONS or len(inside) < SAMPLES:
        return None
    terms = design(u, place)
    chosen = rng.choice(inside, SAMPLES, replace=False)
    equations = np.concatenate([tests[:, 1] @ terms, -tests[:, 0] @ terms], axis=1)
    outward = np.stack([across, down], axis=1)[chosen]
    return Contact(equations, terms[chosen], u[chosen], place[chosen], outward)


def design(change: Floats, place: Floats) -> Floats:
    """Values (N, K) of all TERMS, no unit, for changes (N, 3) at places (N, 2) from -1 to 1."""
    colour = {k: np.prod(change[:, PRODUCTS[k]], axis=1) for k in {k for k, _ in TERMS}}
    power = {m: place[:, 0] ** POWERS[m][0] * place[:, 1] ** POWERS[m][1] for m in {m for _, m in TERMS}}
    return np.stack([colour[k] * power[m] for k, m in TERMS], axis=1)


def _window(
    change: Planes, valid: Bools, x: float, y: float, radius: float
) -> tuple[tuple[Floats, Floats], Floats, Floats, Bools]:
    """Places from the middle in radii, changes (N, 3), places (N, 2) in the picture, and where they are known."""
    height, width = valid.shape
    step = max(1, int(2 * REACH * radius / np.sqrt(MAX_PIXELS)))
    rows = np.arange(max(0, int(y - REACH * radius)), min(height, int(y + REACH * radius) + 1), step)
    columns = np.arange(max(0, int(x - REACH * radius)), min(width, int(x + REACH * radius) + 1), step)
    at = np.ix_(rows, columns)
    known = valid[at].ravel()
    u = np.where(known, np.nan_to_num(np.stack([plane[at].ravel() for plane in change])), 0.0).T.astype(np.float64)
    row, column = (grid.ravel().astype(np.float64) for grid in np.meshgrid(rows, columns, indexing="ij"))
    place = np.stack([2.0 * column / (width - 1) - 1.0, 2.0 * row / (height - 1) - 1.0], axis=1)
    return ((column - x) / radius, (row - y) / radius), u, place, known


def _edges(shape: tuple[int, ...], x: float, y: float, radius: float) -> tuple[float, float, float, float]:
    """Left, right, top and bottom of the picture from the contact's middle, in its radii, all above 0."""
    return x / radius, (shape[1] - 1 - x) / radius, y / radius, (shape[0] - 1 - y) / radius


def _tests(
    across: Floats, down: Floats, known: Bools, *, edges: tuple[float, float, float, float]
) -> Iterator[Floats]:
    """Slopes (2, N) of the test functions, each of the length 1."""
    left, right, top, bottom = edges
    for width in WIDTHS:
        turns = np.arange(SPOKES) * 2.0 * np.pi / SPOKES
        away = APART * width
        for cx, cy in [(0.0, 0.0), *zip(away * np.cos(turns), away * np.sin(turns), strict=True)]:
            room = min(cx + left, right - cx, cy + top, bottom - cy)
            if np.hypot(cx, cy) > FARTHEST or room < SUPPORT * width:
                continue
            x, y = across - cx, down - cy
            bell = np.exp(-0.5 * (x * x + y * y) / width**2)
            if bell[~known].sum() > MAX_INVALID * bell.sum():
                continue
            xx, xy, yy = (one / width**2 for one in (x * x, x * y, y * y))
            for slope in ((-x, -y), (-xy, 1.0 - yy), (1.0 - xx, -xy)):
                pair = np.stack([np.asarray(slope[0] * bell), np.asarray(slope[1] * bell)])
                yield pair / np.sqrt(np.sum(pair**2))
