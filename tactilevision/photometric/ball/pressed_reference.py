"""Was the gel touched when its reference was taken? Ball pictures then show that contact, the wrong way round.

It stands at one place in all pictures, and alike: the colours of a picture there differ from the middle one by
less than a fifth of the change. Real balls that are all pressed at one place, ever deeper, differ by a third;
where they do not, their sizes do.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric.ball.consistency import MIN_SHARE, shared_contact
from tactilevision.photometric.ball.detection import Ball
from tactilevision.photometric.illumination.colour_change import ColourChange
from tactilevision.photometric.illumination.drift import solid
from tactilevision.records import Bytes, Floats, Pair

MIN_PICTURES = 3  # that can be read
CHANGED_SHARE = 0.7  # of the pictures; in the others a ball may press the place itself
# of the change, median over the place: pressed references of six sensors .03 to .12, of a seventh with four
# pictures .15 to .24; balls that are all pressed at one place, of two sensors, .31 and more
MAX_SCATTER = 0.2


def pressed_reference(
    change: ColourChange, pictures: Sequence[Bytes], balls: Sequence[Ball | None]
) -> tuple[Pair | None, float | None]:
    """Where (x, y in px) the reference shows a contact, and the share of `balls` found there; None if none."""
    shared = shared_contact(balls)
    contact_px = shared or contact_in_reference(change, pictures)
    if contact_px is None:
        return None, None
    known = [ball for ball in balls if ball is not None]
    if not known:
        return contact_px, None
    at = [np.hypot(*np.subtract(ball.centre_px, contact_px)) < ball.contact_radius_px for ball in known]
    share = float(np.mean(at))
    if shared is None and share >= MIN_SHARE:
        return None, None  # balls of all sizes, pressed at one place
    return contact_px, round(share, 3)


def contact_in_reference(change: ColourChange, pictures: Sequence[Bytes]) -> Pair | None:
    """Where (x, y in px) the reference of `change` shows a contact, by ball pictures (H, W, 3); None if none."""
    tracker = change.tracker
    changes, touched = [], []
    for rgb in pictures:
        with suppress(InputError):
            seen, drift, _ = change.measure(rgb)
            changes.append([cv2.resize(one, tracker.size, interpolation=cv2.INTER_AREA) for one in seen])
            touched.append(~drift.untouched)
    if len(changes) < MIN_PICTURES:
        return None
    usable = tracker.usable.reshape(touched[0].shape)
    place = solid((np.mean(touched, axis=0) > CHANGED_SHARE) & usable)
    place &= np.pad(np.ones(np.subtract(place.shape, 2), bool), 1)  # light and gel change at the border first
    patches = cv2.connectedComponents(place.astype(np.uint8))[1]
    for _, number in sorted((-np.count_nonzero(patches == n), n) for n in range(1, patches.max() + 1)):
        patch = patches == number
        if _scatter(np.array(changes)[:, :, patch]) <= MAX_SCATTER:
            rows, columns = np.nonzero(patch)
            block = change.reference.shape[1] / tracker.size[0]
            return float(block * (np.median(columns) + 0.5)), float(block * (np.median(rows) + 0.5))
    return None


def _scatter(here: Floats) -> float:
    """How far pictures' changes (K, 3, n) at one place differ, over the middle one; the median over the place."""
    middle = np.median(here, axis=0)
    off = np.linalg.norm(np.median(np.abs(here - middle), axis=0), axis=0)
    return float(np.median(off / np.maximum(np.linalg.norm(middle, axis=0), 1e-9)))
