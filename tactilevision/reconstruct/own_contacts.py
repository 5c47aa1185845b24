"""The light calibrated on what touches the gel in the frames themselves, where no ball was pressed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric import CalibratedMethod, Reference, make_reference
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.contacts.moments import Contact, contact_of
from tactilevision.photometric.contacts.self_calibration import (
    MIN_CONTACTS,
    calibrate_on_contacts,
    contradict,
)
from tactilevision.photometric.illumination.colour_change import ColourChange
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.quality.reference_match import some_frames
from tactilevision.records import Bytes

if TYPE_CHECKING:
    from tactilevision.recording import Recording

MAX_FRAMES = 48  # frames that are looked at; half of them are enough for a law that varies over the picture
RELATIVE_ERROR = 0.5  # of a slope, where no network tells one's scale
# degrees: medians by one and three contacts, or objects, of nine real sensors (benchmarks.own_contacts)
FEW_OFF_DEG = "4 to 15"
FEW_OFF_WITH_NETWORK_DEG = "3 to 13"  # the same with a network
SCALE_STD = 0.6  # of the depth's scale then: nine real sensors .33 to 1.8 of the usual one


def calibrated_on_frames(
    recording: Recording, reference: Reference, *, prior: ReferencedMethod | None
) -> CalibratedMethod | None:
    """A method from contacts in a recording's frames, or None where they are too few to tell the light.

    Its scale is that of `prior`, or a usual one. A prior that the contacts contradict is set aside, unless they
    do not against the median of the frames: then the reference is pressed, and they are taken against that.
    """
    frames = some_frames(recording, count=MAX_FRAMES)
    seen = _contacts(frames, reference)
    contradicted = prior is not None and contradict(seen, prior.law.at)
    if contradicted and prior is not None:
        median = np.median(frames, axis=0).round().astype(np.uint8)
        others = _contacts(frames, make_reference([median], may_have_marks=reference.marks is not None))
        if others and not contradict(others, prior.law.at):
            seen, contradicted = others, False
    prior = None if contradicted else prior
    law = calibrate_on_contacts(seen, None if prior is None else prior.law.at)
    if law is None:
        return None
    known = MethodCard(held_out_gain_std=SCALE_STD) if prior is None else prior.card
    card = MethodCard(
        method=law.name,
        fitted_by="contacts",
        sensor=recording.sensor.kind,
        held_out_gain_std=known.held_out_gain_std,
        steepest_slope=law.steepest,
        other={
            "contacts": len(seen),
            "scale_of": "a usual light" if prior is None else prior.card.sensor,
            "network_contradicted": contradicted,
        },
    )
    error = RELATIVE_ERROR if prior is None else prior.relative_error
    return CalibratedMethod(law, reference, error, None, card)


def _contacts(frames: Sequence[Bytes], reference: Reference) -> list[Contact]:
    """The contacts of rectified frames (H, W, 3) that can be read."""
    change, rng, contacts = ColourChange(reference), np.random.default_rng(0), []
    for rgb in frames:
        with suppress(InputError):
            changes, _, valid = change.measure(rgb)
            contacts.append(contact_of(changes, valid, rng))
    return [one for one in contacts if one is not None]


def scale_warning(method: CalibratedMethod, *, kind: str) -> str:
    """What to expect of a method from contacts alone."""
    told = method.card.other
    count, network = told["contacts"], told["scale_of"] != "a usual light"
    doubt = (
        f"the scale is that of a usual {kind}, at times 40 % off"
        if network
        else "the scale may be off by a factor of two or three"
    )
    few_off = FEW_OFF_WITH_NETWORK_DEG if network else FEW_OFF_DEG
    few = f"; so few have slopes {few_off} degrees off on real frames" if count < MIN_CONTACTS else ""
    contacts = "1 contact" if count == 1 else f"{count} contacts"
    contrary = (
        f". They contradict the ready network for {kind}, which was set aside: is the picture mirrored or turned, "
        "red changed for blue, or the gel touched in its reference?"
        if told["network_contradicted"]
        else ""
    )
    what = f"no ball presses: the light is calibrated on {contacts} in the frames"
    return f"{what}{few}; of their depth {doubt}{contrary}"
