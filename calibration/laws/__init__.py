"""Contact laws, one a file. LAWS is a catalogue, not a gate: any object with the Law protocol works."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from calibration.laws.flat_punch import FlatPunch
from calibration.laws.paper import Paper
from calibration.stages import Law

LAWS: Mapping[str, Law] = MappingProxyType({law.key: law for law in (FlatPunch(), Paper())})
