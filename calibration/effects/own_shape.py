"""A private effect written from the shape of a residual: a file to begin from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactilevision.records.measured import Pair

TEMPLATE = Path(__file__).parent / "own_shape.txt"
KNOWN = {"w": "state.depth_mm", "P": "state.force_N"}  # covariates that the model computes
FORMS = {  # in words, a formula, and code of what is added, over `along`
    "step": ("steps", "size [u > at]", "values[0] * (along > values[1])"),
    "wave": (
        "varies periodically",
        "size cos(2 pi u/period + phase)",
        "values[0] * np.cos(2 * np.pi * along / values[1] + values[2])",
    ),
    "line": ("rises", "size u'", "values[0] * (along - LOW) / REACH"),
    "bend": ("bends", "size u'^2", "values[0] * ((along - LOW) / REACH) ** 2"),
}


@dataclass(frozen=True, slots=True)
class Shape:
    """Shape `kind` of a residual over a covariate of this unit, `relative` to the force or in N.

    `at`: place of a step or period of a wave; `ends`: range of the covariate; `size` and `phase` as found, among
    `searched` forms.
    """

    covariate: str
    unit: str
    kind: str
    relative: bool
    at: float
    ends: Pair
    size: float
    phase: float
    searched: int


def own_effect(shape: Shape, words: str) -> str:
    """Return the text of a private effect of this shape; `words` names its covariate."""
    said, formula, code = FORMS[shape.kind]
    low, high = shape.ends
    unit, reach, size = "1" if shape.relative else "N", high - low, shape.size
    along = KNOWN.get(shape.covariate) or f'covariate(data, "{shape.covariate}")'
    own = f'amplitude("size", "{unit}", {_round(20 * abs(size))}, "size of the error", {_round(abs(size))})'
    parameters, starts = [own], [size]
    if shape.kind in ("step", "wave"):
        step = shape.kind == "step"
        name, meaning = ("at", "where it begins") if step else ("period", "period")
        ends = (shape.at, shape.at) if step else (reach / 20, 2 * reach)
        place = f'"{shape.unit or "1"}", {_round(shape.at)}, ({", ".join(map(_round, ends))})'
        parameters.append(f'Parameter("{name}", {place}, "{meaning}", {_round(reach / 40)})')
        starts.append(shape.at)
    if shape.kind == "wave":
        parameters.append('amplitude("phase", "rad", 7, "phase", 1)')
        starts.append(shape.phase)
    return _filled(
        {
            "WORDS": f"the force {said} with {words}",
            "FORMULA": formula,
            "SEEN": shape.covariate,
            "READS": str("state.force_N" in along),
            "PARAMETERS": ",\n        ".join(parameters),
            "STARTS": ", ".join(map(_round, starts)),
            "SEARCHED": str(shape.searched),
            "ALONG": along,
            "CODE": code.replace("LOW", _round(low)).replace("REACH", _round(reach)),
            "CHANGE": "state.times(force_N=1 + change)" if shape.relative else "state.plus(force_N=change)",
            "SUM": "P (1 + u-part)" if shape.relative else "P + u-part",
        }
    )


def _filled(parts: dict[str, str]) -> str:
    text = TEMPLATE.read_text(encoding="utf-8")
    for name, part in parts.items():
        text = text.replace(f"<{name}>", part)
    return text


def _round(value: float) -> str:
    return f"{value:.4g}"
