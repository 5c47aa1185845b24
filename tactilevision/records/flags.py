"""What makes a height map as a whole doubtful, one word each: `HeightMap.flags`, and what each of them means."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

MOVED = "moved"
LIGHT = "light"
BORDER = "border"
REFERENCE = "reference"
BALLS = "balls"
BEYOND_BALLS = "beyond_balls"
DEEPER = "deeper_than_gel"
UNFIT = "unfit"
ASSUMED_SCALE = "assumed_scale"
INCONSISTENT = "inconsistent_light"
SHADOW = "shadow"
UNKNOWN_LAMPS = "unknown_lamps"
STEEP = "steep"
CONTRARY = "contrary_depths"
MEANING = {
    UNFIT: "the light's calibration fails balls that it never saw: neither direction nor depth of what is pressed "
    "can be trusted",
    DEEPER: "the map is deeper than the gel is thick: no press reads like this, and no depth of it can be true",
    MOVED: "the picture lies beside its reference: depth may be false everywhere",
    REFERENCE: "the reference itself shows a contact, or the gel has changed there since: depth is false there, "
    "and may be everywhere where the light was calibrated with it",
    BALLS: "the light was calibrated on balls in less than half of the picture, along one side at least: depth "
    "elsewhere is extrapolated",
    BEYOND_BALLS: "what is pressed lies beyond the outermost balls that told the light: its depth is "
    "extrapolated, and the stated deviation grows with the distance; press balls there",
    ASSUMED_SCALE: "no ball told how deep a colour is: the depth's scale is that of a usual light, at times 40 % "
    "off or, where no network for the sensor is ready, by a factor of two or three",
    LIGHT: "most of the picture is unlike the reference in a way that no drift explains: another light, a picture "
    "that has moved, or contact over much of it",
    INCONSISTENT: "in places no slope has the colours that are seen, or gel rises further than theory allows: a "
    "shadow, a lamp that changed there, or a light that the method does not know; depth there is uncertain",
    SHADOW: "the sensor's lamps cast shadows beside so deep a contact, and this map keeps them: gel falls too "
    "steeply there. `depth` and `force` undo them, `live --shadows` and load_sensor(path, shadows=True) too",
    UNKNOWN_LAMPS: "the lamps that balls tell do not explain the untouched picture: there are others, or the gel "
    "is unevenly bright. Cast shadows stay, so that a flat face may be read a tenth too shallow or a third too "
    "deep, and gel beside it too steep. Clean the gel and take the reference anew, press balls all over the "
    "picture, or hold faces to a certificate (--calibration)",
    STEEP: "slopes are steeper than any ball that told the light, and belong to no round flat face: what stands "
    "behind them is read too shallow; smaller balls, or deeper presses of them, would tell",
    CONTRARY: "the shadow of a flat face tells another depth of it than its wall's slopes do, by more than both "
    "state: the face's deviation holds both",
    BORDER: "what looks pressed reaches the picture's border: a contact that is cut off, or light from outside",
}


def add(flags: tuple[str, ...], more: Iterable[str]) -> tuple[str, ...]:
    """Both, each once, in the order of MEANING."""
    both = {*flags, *more}
    return tuple(flag for flag in MEANING if flag in both)


def told(counts: Mapping[str, int], frames: int) -> list[str]:
    """A line for each flag: how many of the `frames` have it, and what it means."""
    return [f"{count} of {frames} frames are flagged {flag!r}: {MEANING[flag]}" for flag, count in counts.items()]
