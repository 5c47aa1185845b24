"""One recording from a seed: drawn, computed, read, and written as text; the truth stands apart from it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.others_curves import hidden, noise, protocol
from benchmarks.others_curves.law import BEND, Array
from benchmarks.others_curves.strength import NU_STD, SEEN, StraightLaw, Truth, near, without

KINDS = ("clean", "single", "pair", "outside", "allowed", "near")
EDGE_STD_MM = 0.1  # of edges that nobody stated, as E's interval allows for them
MAX_DRAWS = 200  # of a recording in which another effect lies near: one in five has it
STRENGTHS = (9.0, 14.0)  # std of what is hidden where another effect is to lie near: seen, and not yet told apart
NU_LARGEST = 0.4995  # of what somebody states
HEAD = "press,time_s,depth_mm,fx_N,fy_N,fz_N,phase"


@dataclass(frozen=True, slots=True)
class Made:
    """What is true: the kind, what is hidden and how strong it is in std, the modulus, and what was drawn.

    `each`: std of each hidden effect, beside the law and the other one; `near`: what else could be the one that is
    hidden, within `TOLD_APART` std. `off_N` (N,) is what the best straight law of each radius leaves of what is
    hidden; `force_N` and `slope_N_per_mm` (N,) are those of the gel without it.
    """

    kind: str
    sizes: dict[str, float]
    strength: float
    each: dict[str, float]
    near: list[str]
    modulus_MPa: float
    presses: int
    samples: int
    reader: noise.Reader
    force_N: Array
    slope_N_per_mm: Array
    off_N: Array

    @property
    def told(self) -> dict[str, object]:
        """Plain numbers and words, for a log."""
        names = ("kind", "sizes", "strength", "each", "near", "modulus_MPa", "presses", "samples")
        return {name: getattr(self, name) for name in names} | {
            "noise": self.reader.kind,
            "stated": self.reader.stated,
        }


def make(folder: Path, kind: str, seed: int, *, rich: bool, straight: bool = False, count: int = 0) -> Made:
    """Write the recording of this seed into `folder`; `straight` leaves the law's curve out, `count` presses.

    One of kind "near" is drawn until what is hidden would be seen and another effect lies near it.
    """
    for draw in range(MAX_DRAWS if kind == "near" else 1):
        stream = [seed, KINDS.index(kind), *([2 + draw] if kind == "near" else [])]
        made = _make(folder, kind, stream, rich=rich, straight=straight, count=count)
        if kind != "near" or made.near:
            return made
    raise RuntimeError(f"no recording of seed {seed} has another effect near the one that is hidden")


def _make(folder: Path, kind: str, stream: list[int], *, rich: bool, straight: bool, count: int) -> Made:
    rng = np.random.default_rng(stream)
    rich = rich or kind not in ("clean", "allowed")
    plan = protocol.draw(rng, rich=rich, count=count, sparse=kind == "near")
    reader = noise.draw(rng)
    own = np.random.default_rng([*stream, 1])  # of what was drawn later than all else
    gel = _gel(rng, own, kind, straight=straight)
    stated_nu = min(round(gel.nu + own.normal(0.0, NU_STD), 4), NU_LARGEST)
    same = deepcopy(rng)
    if kind == "near":
        gel = _as_strong(gel, float(own.uniform(*STRENGTHS)), _law(deepcopy(same), gel, plan, reader))
    truth, rows = _read(rng, gel, plan, reader)
    write(folder, plan, reader, stated_nu, rows)
    law = StraightLaw(plan, reader, gel.nu, truth)
    strength, off = law.leaves()

    def errors_N(other: hidden.Gel) -> Array:
        return np.concatenate([error for _, _, error in _read(deepcopy(same), other, plan, reader)[0]])

    each = {key: law.leaves(*map(errors_N, without(gel, key)))[0] for key in gel.sizes}
    alone = kind == "single" or (kind == "near" and strength > SEEN)
    force, slope = (np.concatenate([one[k] for one in truth]) for k in (0, 1))
    told = (kind, dict(gel.sizes), strength, each, near(law, gel, errors_N) if alone else [], gel.modulus_MPa)
    return Made(*told, len(plan.presses), force.size, reader, force, slope, off)


def _law(rng: np.random.Generator, gel: hidden.Gel, plan: protocol.Protocol, reader: noise.Reader) -> StraightLaw:
    return StraightLaw(plan, reader, gel.nu, _read(rng, gel, plan, reader)[0])


def _as_strong(gel: hidden.Gel, strength: float, law: StraightLaw) -> hidden.Gel:
    """The gel with what is hidden no larger than it takes to be this strong, in std."""
    smaller = min(1.0, strength / max(law.leaves()[0], 1e-9))
    return replace(gel, sizes={key: size * smaller for key, size in gel.sizes.items()})


def _gel(rng: np.random.Generator, own: np.random.Generator, kind: str, *, straight: bool) -> hidden.Gel:
    """A gel with what is hidden in a recording of this kind."""
    table = hidden.OUTSIDE if kind == "outside" else hidden.SINGLE
    drawn = {"clean": 0, "pair": 2, "allowed": int(own.integers(2))}.get(kind, 1)
    keys = rng.choice(list(table), drawn, replace=False)
    gel = hidden.Gel(
        modulus_MPa=float(np.round(np.exp(rng.uniform(np.log(0.08), np.log(0.8))), 4)),
        nu=float(rng.choice([0.45, 0.48, 0.49])),
        bend=BEND * float(rng.uniform(0.92, 1.1)),
        curve=float(rng.uniform(-0.3, 0.3)) * (not straight),
        sizes={str(k): float(np.exp(rng.uniform(*np.log(table[k])))) for k in keys},
        tau_s=float(rng.choice([0.5, 2.0, 8.0])),
        at=float(rng.uniform(0.3, 0.7)),
    )
    if kind == "allowed":
        gel = replace(gel, sizes={"edge_fillet": abs(own.normal(0.0, EDGE_STD_MM)), **gel.sizes})
    return gel


Read = tuple[Array, Array, float]


def _read(
    rng: np.random.Generator, gel: hidden.Gel, plan: protocol.Protocol, reader: noise.Reader
) -> tuple[Truth, list[Read]]:
    """Of each press what would be read without noise and without what is hidden, and what is read."""
    sound = hidden.Gel(gel.modulus_MPa, gel.nu, gel.bend, gel.curve, {}, gel.tau_s, gel.at)
    clean, truth, rows = hidden.forces_N(sound, plan), [], []
    zeros = reader.zero_mm * noise.student(rng, reader.heavy, len(plan.presses))
    gains = reader.gain * noise.student(rng, reader.heavy, len(plan.presses))
    for k, (press, force) in enumerate(zip(plan.presses, hidden.forces_N(gel, plan), strict=True)):
        held = (press.depth_mm > 0) | (force < 0)  # by a gel that clings beyond the touch: a depth's noise counts
        share = k / max(len(plan.presses) - 1, 1)
        depth, seen, cross = hidden.misread(gel, press, force, row=k, share=share, rng=rng)
        slope = np.gradient(clean[k], press.depth_mm + 1e-9 * np.arange(force.size), edge_order=1)
        slope = np.where(held, np.median(slope[slope > 0]) if (slope > 0).any() else 0.0, 0.0)
        truth.append((clean[k], slope, seen - clean[k] - slope * (depth - press.depth_mm)))
        seen = seen * (1 + gains[k]) + reader.force_N * noise.samples(rng, reader, force.size)
        if reader.step_N:
            seen = np.round(seen / reader.step_N) * reader.step_N
        depth = depth + zeros[k] + reader.depth_mm * noise.samples(rng, reader, force.size)
        rows.append((depth, seen, cross))
    return truth, rows


def write(
    folder: Path,
    plan: protocol.Protocol,
    reader: noise.Reader,
    stated_nu: float | None,
    rows: list[Read],
    *,
    depth_source: str = "stage",
    tolerances_mm: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Write the folder; `tolerances_mm`: std of the thickness and of a radius, 0 where they are not stated."""
    folder.mkdir(parents=True, exist_ok=True)
    radii = sorted({press.radius_mm for press in plan.presses})
    text = [
        "format = 1",
        'name = "others"',
        "date = 2026-11-02",
        "[sensor]",
        'kind = "custom"',
        "mm_per_px = 0.06",
    ]
    text += ["width_px = 400", "height_px = 300", "[sensor.gel]", f"thickness_mm = {plan.thickness_mm}"]
    text += [f"thickness_std_mm = {tolerances_mm[0]}"] * bool(tolerances_mm[0])
    text += ['shape = "disc"', "radius_mm = 15.0"]
    text += [] if stated_nu is None else [f"poisson_ratio = {stated_nu}", f"poisson_ratio_std = {NU_STD}"]
    if reader.stated:
        text += ["[force]", f"std_N = [{reader.force_N}, {reader.force_N}, {reader.force_N}]"]
    text += ["[depth]", f'source = "{depth_source}"']
    if reader.stated and reader.depth_mm:
        text += [f"std_mm = {reader.depth_mm}"]
    for a in radii:
        text += [f"[indenter.R{100 * a:.0f}]", 'shape = "flat_cylinder"', f"radius_mm = {a}"]
        text += [f"radius_std_mm = {tolerances_mm[1]}"] * bool(tolerances_mm[1])
    (folder / "recording.toml").write_text("\n".join(text) + "\n", encoding="utf-8")
    presses = ["press,indenter,start_s,end_s,x_mm,y_mm,rest_s,speed_mm_s,hold_s,temperature_C,date"]
    curves = [HEAD]
    for k, (press, (depth, force, cross)) in enumerate(zip(plan.presses, rows, strict=True)):
        name, (x, y) = f"p{k + 1:03d}", press.place_mm
        warm = f"{press.temperature_C}" if np.isfinite(press.temperature_C) else ""
        presses.append(
            f"{name},R{100 * press.radius_mm:.0f},{press.time_s[0]:.4f},{press.time_s[-1]:.4f},{x},{y},"
            f"{press.rest_s:.2f},{press.speed_mm_s},{press.hold_s},{warm},2026-11-{1 + press.day:02d}"
        )
        for t, w, p, phase in zip(press.time_s, depth, force, press.phase, strict=True):
            curves.append(f"{name},{t:.5f},{w:.6f},{cross * p:.6f},0.0,{p:.6f},{phase}")
    (folder / "presses.csv").write_text("\n".join(presses) + "\n", encoding="utf-8")
    (folder / "curves.csv").write_text("\n".join(curves) + "\n", encoding="utf-8")
