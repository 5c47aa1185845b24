"""A workbench on made-up presses with a planted zero of the depth, for tests without a browser."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "calibration"))
from made_presses import GEL, indenter, observations

from calibration.effects import EFFECTS
from calibration.effects.depth_zero import DepthZero
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.stages import Effect
from calibration.tasks.session import History
from calibration.workbench.bench import Bench, Shown
from calibration.workbench.opened import Opened

LOOKED_FOR = ("depth_zero", "force_bias", "thickness", "ageing")  # few, quickly fitted, one not testable
ZERO_MM = 0.03  # planted
PRESSES = 6  # enough for folds of presses, and quick


def presses() -> Observations:
    """One radius, down and up again, 4 mN a sample and .5 % a press."""
    rng = np.random.default_rng(3)
    depth = np.concatenate([np.linspace(0.03, 0.6, 9), np.linspace(0.54, 0.03, 6)])
    data = observations(
        [depth] * PRESSES,
        [indenter()] * PRESSES,
        time_s=[300.0 * k + np.linspace(0, 3, depth.size) for k in range(PRESSES)],
        phase=[["load"] * 9 + ["unload"] * 6] * PRESSES,
        gel=replace(GEL, poisson_ratio=0.48, poisson_ratio_std=0.002),
    )
    model = FlatPunch() + DepthZero()
    values = model.defaults(data)
    values[0], values[model.slices(data)["depth_zero"]] = 0.2, ZERO_MM
    force = model.predict(values, data)
    gain = 0.005 * rng.standard_normal(data.count)
    return data.with_force(force * (1 + gain[data.press]) + 0.004 * rng.standard_normal(data.size))


def bench(
    out: Path,
    *,
    private: tuple[Effect, ...] = (),
    files: dict[str, str] | None = None,
    history: History | None = None,
) -> Bench:
    """With its first model fitted; nothing asked of a diagnosis."""
    return of_data(presses(), out, private=private, files=files, history=history)


def of_data(
    data: Observations,
    out: Path,
    *,
    listed: tuple[str, ...] = LOOKED_FOR,
    private: tuple[Effect, ...] = (),
    files: dict[str, str] | None = None,
    history: History | None = None,
) -> Bench:
    """The same of other measurements."""
    effects = tuple(EFFECTS[key] for key in listed)
    opened = Opened((), (), data, private=private, files=files or {}, listed=effects)

    def export(_shown: Shown, _opened: Opened, folder: Path) -> Path:
        (folder / "report.html").write_text("report")
        return folder / "report.html"

    def keep(kept: History) -> None:
        kept.save(out / "history.json")

    made = Bench(opened, history or History(("made",)), export=export, keep=keep, out=out, asks=False)
    made.work(until_idle=True)
    return made


def do(made: Bench, action: str, value: str = "") -> Shown:
    """One action, waited for."""
    made.act(action, value)
    made.work(until_idle=True)
    return made.shown
