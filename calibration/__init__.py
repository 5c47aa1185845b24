"""Contact laws and effects fitted to depth and force: E, nu, and what the model lacks.

The public names, gathered. Nothing heavy is loaded before it is used.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tactilevision.renamed import PublicPackage, install

if TYPE_CHECKING:
    from calibration.effects import EFFECTS
    from calibration.effects.viscoelasticity import Viscoelasticity
    from calibration.inputs.observations import Measured, Observations
    from calibration.laws import LAWS
    from calibration.model.parameters import Parameter
    from calibration.model.stages import Effect, EffectBase, Stage, State
    from calibration.tasks.calibrate import calibrate, observe
    from calibration.tasks.compare import compare
    from calibration.tasks.diagnose import diagnose
    from calibration.tasks.forecast import Design, PressNoise
    from calibration.tasks.history import history
    from calibration.tasks.plan import Goal, plan
    from calibration.tasks.validate import validate

_PLACES = {
    "effects": ("EFFECTS",),
    "effects.viscoelasticity": ("Viscoelasticity",),
    "inputs.observations": ("Measured", "Observations"),
    "laws": ("LAWS",),
    "model.parameters": ("Parameter",),
    "model.stages": ("Effect", "EffectBase", "Stage", "State"),
    "tasks.calibrate": ("calibrate", "observe"),
    "tasks.compare": ("compare",),
    "tasks.diagnose": ("diagnose",),
    "tasks.forecast": ("Design", "PressNoise"),
    "tasks.history": ("history",),
    "tasks.plan": ("Goal", "plan"),
    "tasks.validate": ("validate",),
}
_HOME = {name: place for place, names in _PLACES.items() for name in names}

__all__ = [
    "EFFECTS",
    "LAWS",
    "Design",
    "Effect",
    "EffectBase",
    "Goal",
    "Measured",
    "Observations",
    "Parameter",
    "PressNoise",
    "Stage",
    "State",
    "Viscoelasticity",
    "calibrate",
    "compare",
    "diagnose",
    "history",
    "observe",
    "plan",
    "validate",
]


install()  # old names, for one version
sys.modules[__name__].__class__ = PublicPackage


def __getattr__(name: str) -> Any:
    """Load a public name's module when the name is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module 'calibration' has no attribute {name!r}")
    found = getattr(import_module(f"calibration.{_HOME[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
