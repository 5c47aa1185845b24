"""Does a calibration hold for balls that it never saw? One that fails its own balls says nothing of others.

Balls are left out of the fit in turn. The median angle between their slopes, true and read, and the median ratio
of their depth, read over true, stand in the method's card. On five real sets they are 2 to 5 degrees and .92 to
1.00. Circles where no ball is give 78 degrees and no depth, nearly white light 24 degrees, white light 60.
"""

from __future__ import annotations

from tactilevision.errors import InputError
from tactilevision.photometric.card import MethodCard

MAX_DIRECTION_DEG = 17.0  # degrees: real sensors 2 to 6, ready networks 6 to 10 on drawn lights, failures 19 to 55
MAX_SHARE_AT_CONTACT = 0.25  # of the balls at a contact in the reference: the law is learnt from that, upside down
MIN_RATIO = 0.6  # of the depth: real sensors .91 to .98; failures .4
MAX_RATIO = 1.6  # of the depth: as far off the other way


def unfit(card: MethodCard) -> str:
    """What says that a method fails its own balls, as its `card` has it; empty where nothing does."""
    faults, share = [], card.balls_at_that_contact or 0.0
    if share >= MAX_SHARE_AT_CONTACT:
        faults.append(f"{100 * share:.0f} % of the balls found are a contact in the reference")
    direction, ratio = card.held_out_direction_error_deg, card.other.get("held_out_depth_ratio")
    if direction is not None and direction > MAX_DIRECTION_DEG:
        faults.append(
            f"slopes of balls left out point {direction:.1f} degrees off (at most {MAX_DIRECTION_DEG:.0f} are fit)"
        )
    if isinstance(ratio, float | int) and not MIN_RATIO < ratio < MAX_RATIO:
        faults.append(
            f"depth of balls left out is {ratio:.2g} of the true one ({MIN_RATIO:g} to {MAX_RATIO:g} are fit)"
        )
    return ", ".join(faults)


def scale_is_assumed(card: MethodCard) -> bool:
    """Whether no ball told the scale of slopes: a network of drawn lights, or contacts of unknown shape."""
    return card.fitted_by == "contacts" or "scenes" in card.other


def unfit_warnings(card: MethodCard) -> tuple[str, ...]:
    """A warning of a calibration that fails its own balls."""
    fault = unfit(card)
    if not fault:
        return ()
    return (
        f"the light's calibration fails its own balls: {fault}. Check that nothing touches the gel in "
        "reference/flat, centres and radii in reference/ball.csv, mm_per_px, and that the light has three colours",
    )


def check_fit(card: MethodCard, *, remedy: str, where: str = "reference/ball") -> None:
    """Raise InputError for a calibration that fails its own balls; `remedy` says how to go on all the same.

    `where` is what holds the calibration.
    """
    fault = unfit(card)
    if fault:
        raise InputError(
            "the light's calibration fails its own balls",
            where=where,
            value=fault,
            remedy=f"Check flat/, ball.csv, mm_per_px and the lamps; {remedy} goes on all the same.",
        )
