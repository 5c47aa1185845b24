"""Every module and public name of the version before is found under its old name, with a warning."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import calibration
from calibration.effects.support.private import load_effect
from tactilevision.renamed import renamed

BEFORE = Path(__file__).parent / "data" / "before"
OLD = {
    module: names.split()
    for module, _, names in (line.partition(":") for line in (BEFORE / "modules.txt").read_text().splitlines())
}
GONE = {  # the module stands; what it lost was of use to the package alone
    "calibration.hereditary.Grid",
    "calibration.repeats.pure_error.noise_floor",
    "calibration.effects.bevel_rise.supposed",
    "calibration.missing.screen.seen_covariates",
    "calibration.pages.drawing.residual_panels",
    "tactilevision.depth_error.place_gain_std",
    "tactilevision.cli.diagnose.compare",
    "tactilevision.cli.diagnose.steps",
    "tactilevision.cli.findings.drawn_cards",
    "tactilevision.cli.pictures.keep",
    "tactilevision.cli.source.open_anchor",
    "tactilevision.cli.source.open_branch",
    "tactilevision.cli.source.open_reconstructor",
    "tactilevision.cli.source.open_source",
    "tactilevision.mechanics.tables.tabulate.cluster",
    "tactilevision.streaming.clear_leftovers",
    "tactilevision.streaming.fingerprint_of",
    "tactilevision.photometric.calibrate.locate",
    "tactilevision.photometric.drawn_samples.draw_slopes",
    "tactilevision.photometric.method.Evaluator",
    "tactilevision.photometric.response.response_in",
    "tactilevision.plots.diagnosis.Panel",
    "tactilevision.plots.diagnosis.draw_relief",
    "tactilevision.plots.diagnosis.draw_residuals",
    "tactilevision.plots.diagnosis.draw_waterfall",
    "tactilevision.plots.style.new_strip",
    "tactilevision.plots.style.save_png",
    "tactilevision.press.checks.face_tilt",
    "tactilevision.reconstruct.build.untouched_rms_mm",
    "tactilevision.records.measured.CertifiedPoint",
}
FIND_ALL = """
import importlib, sys, warnings
warnings.simplefilter("ignore")
for line in sys.stdin:
    module, _, names = line.partition(":")
    found = importlib.import_module(module)
    missing = [f"{module}.{name}" for name in names.split() if not hasattr(found, name)]
    print(*missing, sep="\\n", end="\\n" if missing else "")
"""


def test_every_old_module_and_public_name_is_found() -> None:
    text = (BEFORE / "modules.txt").read_text()
    done = subprocess.run(
        [sys.executable, "-c", FIND_ALL], input=text, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert set(done.stdout.split()) == GONE


def test_the_warning_names_the_new_one_and_points_at_the_caller() -> None:
    old = import_module("tactilevision.rim")
    with pytest.warns(
        DeprecationWarning, match=r"rim\.Rim is now tactilevision\.integration\.circular_edges\.CircularEdge"
    ) as said:
        found = old.Rim
    assert said[0].filename == __file__
    assert found is import_module("tactilevision.integration.circular_edges").CircularEdge


def test_an_old_module_never_hides_a_public_function() -> None:
    for name in ("calibrate", "compare", "history"):
        old = import_module(f"calibration.{name}")
        assert callable(getattr(calibration, name))
        assert getattr(calibration, name) is not old


def test_what_never_was_is_an_error_as_ever() -> None:
    with pytest.raises(ModuleNotFoundError):
        import_module("tactilevision.nonsense")
    with pytest.raises(AttributeError, match="nonsense"):
        import_module("tactilevision.rim").nonsense  # noqa: B018 - the look-up itself is the test
    with pytest.raises(AttributeError, match="certify"):
        import_module("tactilevision.press").certify_all  # noqa: B018


def test_the_table_leads_to_what_is_there() -> None:
    for old, new in renamed().items():
        assert old != new
        if old in OLD and new:
            import_module(new)


def test_a_private_effect_of_before_still_loads(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text((BEFORE / "template.txt").read_text().replace("NAME", "Mine").replace("KEY", "mine"))
    with pytest.warns(DeprecationWarning, match="is now") as said:
        effect = load_effect(path)
    assert any("calibration.stages.EffectBase is now calibration.model.stages" in str(one.message) for one in said)
    assert effect.key == "mine"
