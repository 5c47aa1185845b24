"""Contact laws, one a file. LAWS is the catalogue; any object with the Law protocol works as well."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

from calibration.laws.flat_punch import FlatPunch
from calibration.laws.paper import Paper
from calibration.laws.round_bodies import RoundBody
from calibration.model.stages import Law
from tactilevision.errors import check_known

_LAWS: tuple[Law, ...] = (FlatPunch(), Paper(), RoundBody("sphere"), RoundBody("cone"))
LAWS: Mapping[str, Law] = MappingProxyType({law.key: law for law in _LAWS})


FLAT = "flat_cylinder"


def shape_of(law: Law) -> str:
    """Return the indenter's shape that a law is for."""
    return str(getattr(law, "shape", FLAT))


def get_law(key: str, shapes: Collection[str]) -> Law:
    """Return the law of this key. Raises InputError for an unknown key.

    "default" is the first law for one of these shapes of indenters, a flat cylinder's where there is one.
    """
    check_known(key, ["default", *LAWS], what="there is no contact law of this name", where="law")
    suits = (law for law in LAWS.values() if shape_of(law) in shapes)
    return next(suits, LAWS["flat_punch"]) if key == "default" else LAWS[key]
