"""Contact laws, one a file. LAWS is a catalogue, not a gate: any object with the Law protocol works."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

from calibration.laws.flat_punch import FlatPunch
from calibration.laws.paper import Paper
from calibration.laws.round_bodies import Cone, Sphere
from calibration.model.stages import Law
from tactilevision.errors import InputError

LAWS: Mapping[str, Law] = MappingProxyType({law.key: law for law in (FlatPunch(), Paper(), Sphere(), Cone())})


FLAT = "flat_cylinder"


def shape_of(law: Law) -> str:
    """The indenter's shape that a law is for."""
    return str(getattr(law, "shape", FLAT))


def default_law(shapes: Collection[str]) -> Law:
    """The default law for indenters of these shapes: a flat cylinder's where there is one, else the body's own."""
    known: dict[str, Law] = {FLAT: FlatPunch(), "sphere": Sphere(), "cone": Cone()}
    return next((law for shape, law in known.items() if shape in shapes), FlatPunch())


def get_law(key: str) -> Law:
    """The law of this key; "default" is flat_punch. Raises InputError for an unknown key."""
    name = "flat_punch" if key == "default" else key
    if name not in LAWS:
        raise InputError(
            "there is no contact law of this name",
            where="law",
            value=key,
            remedy=f"Choose among: default, {', '.join(LAWS)}.",
        )
    return LAWS[name]
