from .effects import EFFECTS as EFFECTS
from .effects.viscoelasticity import Viscoelasticity as Viscoelasticity
from .inputs.observations import Measured as Measured, Observations as Observations
from .laws import LAWS as LAWS
from .model.stages import (
    Effect as Effect,
    EffectBase as EffectBase,
    Parameter as Parameter,
    Stage as Stage,
    State as State,
)
from .tasks.calibrate import calibrate as calibrate, history as history, observe as observe
from .tasks.compare import compare as compare
from .tasks.diagnose import diagnose as diagnose
from .tasks.plan import Design as Design, Goal as Goal, PressNoise as PressNoise, plan as plan
from .tasks.validate import validate as validate
