"""The contact event: first touch of the bevel, as it was certified."""

from __future__ import annotations

from dataclasses import dataclass

from tactilevision.contact.bevel_onset import Onset


@dataclass(frozen=True, slots=True)
class ContactEvent:
    """First touch of the bevel: camera time and std, the depth that the camera read then, channel, onset.

    `seen_s`: when frames showed it, where the travel scale has moved it since; else NaN.
    """

    time_s: float
    std_s: float
    depth_seen_mm: float
    channel: str
    onset: Onset
    seen_s: float = float("nan")
