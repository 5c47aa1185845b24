"""An effect is one file: it states all that is known of it, and no other file of the package knows its key."""

from __future__ import annotations

import ast
from pathlib import Path

from each import each
from test_effects import rich

import calibration
from calibration.effects import EFFECTS, in_picture
from calibration.inputs.conditions import covariates
from calibration.model.stages import EffectBase, Stage

PACKAGE = Path(calibration.__file__).parent
OTHERS = sorted(path for path in PACKAGE.rglob("*.py") if "effects" not in path.relative_to(PACKAGE).parts)
HOMONYMS = {  # words that are keys of effects by accident
    ("model/stages.py", "thickness"): "a condition of the rig",
    ("tasks/passport.py", "friction"): "a key of passport.json",
    ("tasks/passport.py", "temperature"): "a key of passport.json",
    ("tasks/passport.py", "thickness"): "a key of passport.json",
    ("tasks/validate.py", "friction"): "a column of the finite elements' friction",
}
OF_GEL = set(Stage) - {Stage.DEPTH, Stage.INSTRUMENT}  # those are definitions: no form can be off
PUBLIC = {"__init__.py": "calibration.effects.viscoelasticity"}  # the public API offers one to start from


def effects_known(path: Path) -> set[str]:
    """Keys of effects that stand in a file as strings, and modules and classes of effects that it imports."""
    named = {f"calibration.effects.{key}" for key in EFFECTS}
    named |= {f"calibration.effects.{type(effect).__name__}" for effect in EFFECTS.values()}
    known: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Constant) and node.value in EFFECTS:
            known.add(str(node.value))
        elif isinstance(node, ast.Import):
            known |= named & {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            known |= named & {node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)}
    return known


@each("path", OTHERS)
def test_no_other_file_knows_an_effect(path: Path) -> None:
    name = path.relative_to(PACKAGE).as_posix()
    known = {key for key in effects_known(path) if (name, key) not in HOMONYMS and PUBLIC.get(name) != key}
    assert not known, "ask the effect: see EffectBase"


def test_a_file_that_knows_an_effect_is_found(tmp_path: Path) -> None:
    path = tmp_path / "knows.py"
    path.write_text(
        "from calibration.effects.tilt import Tilt\nfrom calibration.effects import skin, Friction\n"
        "import calibration.effects.ageing\nif key == 'friction':\n    pass\n"
    )
    modules = {f"calibration.effects.{name}" for name in ("tilt", "skin", "Friction", "ageing")}
    assert effects_known(path) == {"friction", *modules}


@each("effect", EFFECTS.values())
def test_an_effect_states_all_that_is_known_of_it(effect: EffectBase) -> None:
    own = vars(type(effect))
    assert {"key", "title", "stage", "seen_in", "separated_by", "source", "order"} <= set(own)
    first = effect.parameters[0]
    if effect.largest is not None:
        assert 0 < effect.largest <= max(abs(bound - first.default) for bound in first.bounds)
    if effect.check is not None:
        assert effect.check.minutes > 0
        assert effect.check.action


@each("effect", [e for e in EFFECTS.values() if e.stage in OF_GEL])
def test_a_form_is_allowed_for_along_all_that_an_effect_of_the_gel_is_seen_in(effect: EffectBase) -> None:
    """Names that no covariate has are passed over; the azimuth follows the place, and the order the day."""
    assert set(effect.seen_in) <= {covariate.name for covariate in covariates(rich())}
    for along, follows in (({"x", "y"}, "azimuth"), ({"recording date"}, "order")):
        assert follows in effect.seen_in or not along <= set(effect.seen_in)


def test_orders_differ_and_follow_the_stages_of_the_catalogue() -> None:
    orders = [effect.order for effect in EFFECTS.values()]
    assert orders == sorted(set(orders))
    assert [effect.key for effect in EFFECTS.values()] == list(EFFECTS)
    assert orders == sorted(orders)


def test_ranks_of_what_may_be_instead_of_beta_differ() -> None:
    ranks = sorted(e.instead_of_beta for e in EFFECTS.values() if e.instead_of_beta)
    assert ranks == list(range(1, len(ranks) + 1))


@each("effect", EFFECTS.values())
def test_what_the_picture_shows_bears_the_same_name(effect: EffectBase) -> None:
    shown = effect.in_picture()
    if shown is None:
        assert not hasattr(effect, "seen")
    else:
        assert isinstance(shown, in_picture.InPicture)
        assert (shown.key, shown.order, shown.stage) == (effect.key, effect.order, Stage.DEPTH)
