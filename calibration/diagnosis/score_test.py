"""One test of everything that may end in anything but ADEQUATE, at one level, on presses that are no repeats.

A direction is the change of the force that an effect or a plain error of the rig would bring (from each of its
starts), or a step function of a covariate. Whitened and freed of what the fit can absorb, its score is
t = d.z/|d|. What changes from press to press passes for their scatter, and so hides itself: t^2 is therefore
taken as a likelihood ratio, in which presses may scatter less with the direction than without it (`Cast.ratios`).
Of an effect and of a plain error the largest t^2 over its starts counts, so that its range is searched; of a
covariate the sum over its bins. Beside them stand the scatter of loading, the press farthest from its like and
how presses' zeros wander. All are held against one parametric bootstrap, in which samples and presses are drawn
with the tails that they have and the error model is estimated anew. What an effect in the fit leaves where a gel
follows another form of it (`form_errors`) is in the fit, and no finding. The level is shared: effects have
`SHARE` of it, everything else the rest, each by its own smallest p; p_adjusted is p for having looked at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.diagnosis.covariates import covariate_steps, form_errors
from calibration.diagnosis.score_statistics import Cast, Tail
from calibration.diagnosis.sensitivity import as_it_holds, smallest_visible
from calibration.effects.instrument_errors import INSTRUMENT_ERRORS
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.least_squares import Fit
from calibration.fit.outlying_presses import PressLooks
from calibration.fit.repeats import renewed_noise
from calibration.inputs.deadline import Each, in_turn
from calibration.inputs.observations import Observations
from calibration.model.stages import Effect
from calibration.noise.model import Noise, Scatter
from tactilevision.errors import InputError
from tactilevision.records.measured import Floats

DRAWS = 399  # of the bootstrap: p to .0025, finer by the tail's fit
FIRST_DRAWS = 99  # after which it ends where all is decided
MANY_DRAWS = 1999  # where p lies near a level: heavy presses moved p of 399 300 times, of these 3 (others_curves)
NEAR_LEVELS = (1e-5, 0.2)  # p between which more draws may decide otherwise: 6.5e-5 of 399 was .002 to .005
PORTION = 300  # draws made at once
PORTION_VALUES = 4.5e6  # forces made at once, 36 MB: fewer draws from 15,000 samples on
BATCH = 50  # draws of one step, which any process may do: .2 s for 1600 samples
FAR_FROM = (
    4.0  # times the level: of 99 draws a fifth or more are below p, and with p at the level 1e-7 of the time
)
LEVEL = 0.05  # of all that may end in anything but ADEQUATE
SHARE = 0.6  # of the level that effects have: they are more, and what they name can be put right
SCATTER = "scatter while loading"
ONE_WAY = 0.9999  # cosine from which two directions are one

LESS = (1.0, 0.125, 0.25, 0.5)  # over the presses' estimated gain, that are tried: 4 % may be .5 %
MORE = (2.0, 4.0)  # as well, where presses are too few to tell it: 1 % may be 4 %
FEW_PRESSES = 12  # fewer hardly tell how they scatter: six or seven gains beside the law
FEW_POINTS = 24  # of one reading a press, which is all that tells how presses scatter

_Rows = tuple[Floats, Floats, Floats]  # scores (b, k), scatter while loading (b, M'), what presses say (b, q)


class Failure(str):
    """The reason that an effect cannot be tested: it raised an error."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Scored:
    """One effect or covariate: its statistic, its own p, and p adjusted for having looked at all.

    `usual` is the statistic's mean where nothing is there.
    """

    key: str
    statistic: float
    p: float
    p_adjusted: float
    usual: float = 0.0

    def as_json(self) -> dict[str, str | float]:
        """One entry of covariates."""
        return {"name": self.key, "p_adjusted": self.p_adjusted}


@dataclass(frozen=True, slots=True)
class ScoreTest:
    """The scores of effects and of covariates, the most telling first, and why others were not looked at.

    `others` are plain errors of the rig and what is odd among presses.
    `visible` is, for each effect, the amplitude of its first parameter that would be seen in 4 of 5 such data; inf
    where the base model absorbs it.
    """

    effects: tuple[Scored, ...]
    covariates: tuple[Scored, ...]
    not_testable: Mapping[str, str]
    visible: Mapping[str, float]
    others: tuple[Scored, ...] = ()

    @property
    def lack_of_fit(self) -> float:
        """Adjusted p of the most telling of all but effects; 1 where there is none."""
        return min((c.p_adjusted for c in (*self.covariates, *self.others)), default=1.0)

    @property
    def family_p(self) -> float:
        """p of all that was looked at: what anything but ADEQUATE begins with."""
        return min([self.lack_of_fit, *(s.p_adjusted for s in self.effects)])


def score_test(
    fitted: Fit,
    effects: Sequence[Effect],
    *,
    rng: np.random.Generator,
    draws: int = DRAWS,
    of_rig: bool = False,
    each: Each = in_turn,
) -> ScoreTest:
    """Score `effects` and every covariate against the residual of `fitted`, whose noise is taken as its own; with
    `of_rig` plain errors of the rig and presses that are odd as well.
    """
    fitted = at_denoised_depth(fitted)
    tables, missing = effect_directions(fitted, effects)
    plain, _ = effect_directions(fitted, INSTRUMENT_ERRORS if of_rig else ())
    plain = {key: _either_way(table) for key, table in plain.items()}
    steps = covariate_steps(fitted)
    cast = Cast(fitted, [*tables.values(), *plain.values(), *steps.values()], form_errors(fitted))
    for key, table in zip(tables, cast.left[: len(tables)], strict=True):
        if not table.any():
            missing[key] = "the base model takes all of it: these data cannot tell it from E, nu or beta"
    looks = _Looks(cast, fitted, searched=len(tables) + len(plain), of_rig=of_rig)
    few = scatter_unknown(fitted.data)
    keys = [*tables, *plain, *steps, *looks.names]
    rows = [looks.own(), *looks.drawn(rng, min(FIRST_DRAWS, draws), each)]
    table = looks.table(rows)
    found = _family(keys, table, len(tables), missing)
    undecided = ((draws, (0.0, FAR_FROM * LEVEL)), (MANY_DRAWS if draws >= DRAWS else draws, NEAR_LEVELS))
    for enough, (low, high) in undecided:
        smallest = min((s.p_adjusted for part in found for s in part), default=1.0)
        if len(table) <= enough and low <= smallest < high:
            rows += looks.drawn(rng, enough + 1 - len(table), each)
            table = looks.table(rows)
            found = _family(keys, table, len(tables), missing)
    named, rest, of_residual = *found, {*steps, SCATTER}
    return ScoreTest(
        effects=named,
        covariates=tuple(s for s in rest if s.key in of_residual),
        not_testable=missing,
        visible=smallest_visible(
            cast, effects, list(tables), level=SHARE * LEVEL, drawn=table[1:, : len(tables)] if few else None
        ),
        others=tuple(s for s in rest if s.key not in of_residual),
    )


def few_presses(data: Observations) -> bool:
    """Whether these are curves of so few presses that what changes from one to the next passes for scatter."""
    return data.is_curves and data.count < FEW_PRESSES


def scatter_unknown(data: Observations) -> bool:
    """Whether presses are too few to tell how they scatter."""
    return few_presses(data) or (not data.is_curves and data.count < FEW_POINTS)


def _family(
    keys: Sequence[str], table: Floats, effects: int, missing: Mapping[str, str]
) -> tuple[tuple[Scored, ...], tuple[Scored, ...]]:
    """The effects, the first so many of the statistics, and the rest; without effects the level is the rest's."""
    share = SHARE if effects else 0.0
    parts = ((slice(0, effects), share), (slice(effects, None), 1 - share))
    named, rest = (_ranked(keys[part], table[:, part], skip=missing, share=own) for part, own in parts)
    return named, rest


class _Looks:
    """All statistics of one fit: of an effect and a plain error the largest score squared, of a covariate the sum,
    the scatter of loading, and with `of_rig` the presses; `names` of the last two.
    """

    def __init__(self, cast: Cast, fitted: Fit, *, searched: int, of_rig: bool) -> None:
        self._cast, self._fitted, self._searched = cast, fitted, searched
        self._gains = (*LESS, *MORE) if scatter_unknown(fitted.data) else LESS
        self._scatter = Scatter(fitted.data)
        self._presses = PressLooks(fitted) if of_rig else None
        self.names = [*([SCATTER] if self._scatter.seen else []), *(self._presses.names if self._presses else [])]

    def own(self) -> _Rows:
        """What the residual itself says."""
        return self._part(self._fitted.residual_N[:, None], self._cast.own_priors[:, None], [self._fitted.noise])

    def drawn(self, rng: np.random.Generator, draws: int, each: Each) -> list[_Rows]:
        """The same of so many draws, made in portions; a batch of draws is one step."""
        most, rows = max(1, min(PORTION, int(PORTION_VALUES / self._fitted.data.size))), []
        for begin in range(0, draws, most):
            errors, priors = self._cast.null(rng, min(most, draws - begin))
            cuts = np.arange(0, errors.shape[1], BATCH)[1:]
            given = list(zip(np.split(errors, cuts, axis=1), np.split(priors, cuts, axis=1), strict=True))
            rows += [fetch() for fetch in each(self._drawn, given)]
        return rows

    def table(self, rows: Sequence[_Rows]) -> Floats:
        """Statistics (1 + draws, n) of the residual, first of `rows`, and of draws, which say what is usual."""
        scores, loading, presses = (np.concatenate(part) for part in zip(*rows, strict=True))
        if not self._scatter.seen:
            return np.hstack([scores, presses])
        usual = float(np.mean([one.mean() for one in loading[1:]]))
        scattered = np.array([self._scatter.statistic(one, usual) for one in loading])
        return np.column_stack([scores, scattered, presses])

    def _drawn(self, given: tuple[Floats, Floats]) -> _Rows:
        """`_part` of drawn errors (N, b) and priors (k, b), each under the noise estimated anew from it."""
        return self._part(*given, renewed_noise(self._fitted, given[0]))

    def _part(self, errors: Floats, priors: Floats, noises: Sequence[Noise]) -> _Rows:
        """Scores (b, k), how much more each press scatters while loading (b, M'), and what presses say (b, q)."""
        count, most = len(noises), self._searched
        scores = np.array(
            [
                [*(np.max(s**2, initial=0.0) for s in row[:most]), *(np.sum(s**2) for s in row[most:])]
                for row in self._cast.ratios(noises, errors, priors, gains=self._gains)
            ]
        ).reshape(count, -1)
        loading, presses = np.zeros((count, 0)), np.zeros((count, 0))
        if self._scatter.seen:
            white = (self._cast.white(noise, errors[:, k], priors=priors[:, k]) for k, noise in enumerate(noises))
            loading = np.array([self._scatter.differences(one) for one in white])
        if self._presses is not None:
            presses = self._presses.statistics(self._cast.left_of(errors, priors)).T
        return scores, loading, presses


def _either_way(table: Floats) -> Floats:
    """Directions (N, s) without those that are another's opposite, or the same."""
    unit = table / np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    alike = np.triu(np.abs(unit.T @ unit) > ONE_WAY, k=1).any(axis=0)
    return np.asarray(table[:, ~alike])


def effect_directions(fitted: Fit, effects: Sequence[Effect]) -> tuple[dict[str, Floats], dict[str, str]]:
    """Change of the force (N, s) for each start of each effect that can be tested, and why others cannot."""
    tables: dict[str, Floats] = {}
    missing: dict[str, str] = {}
    data, base = fitted.data, fitted.force_N
    for effect in effects:
        if effect.key in fitted.model.keys:
            continue
        try:
            why = effect.missing(data)
            if not why:
                tables[effect.key] = _directions(fitted, effect, base)
        except (Exception, SystemExit) as fault:  # of a private effect, anything; the rest of the analysis goes on
            why = Failure(f"it failed: {type(fault).__name__}: {fault}")
        if why:
            missing[effect.key] = why
    return tables, missing


def _directions(fitted: Fit, effect: Effect, base: Floats) -> Floats:
    model = fitted.model + effect
    place = model.slices(fitted.data)[effect.key]
    off = len(model.parameters(fitted.data)) - len(effect.parameters)
    values = np.insert(fitted.values, place.start, np.zeros(place.stop - place.start))
    assert values.size == off + len(effect.parameters)
    columns = []
    for start in effect.starts(fitted.data):
        values[place] = start
        force = np.asarray(model.predict(values, fitted.data))
        if force.shape != base.shape:
            raise InputError("an effect returns one force a sample", where=effect.key, value=force.shape)
        if np.iscomplexobj(force):
            raise InputError("an effect returns real forces", where=effect.key, value=start.tolist())
        if not np.isfinite(force).all():
            raise InputError("an effect returns finite forces", where=effect.key, value=start.tolist())
        columns.append(as_it_holds(fitted, model, values, force - base))
    return np.column_stack(columns)


def _ranked(keys: Sequence[str], table: Floats, *, skip: Mapping[str, str], share: float) -> tuple[Scored, ...]:
    """p of each statistic, real in the first row of `table` and drawn in the others, and adjusted for the smallest
    of all by the same draws and for the `share` of the level that they have.
    """
    kept = [k for k, key in enumerate(keys) if key not in skip]
    if not kept:
        return ()
    real, null = table[0], table[1:]
    tails = {k: Tail(null[:, k]) for k in kept}
    family = Tail(-np.log(np.min([tails[k].of_each() for k in kept], axis=0)))
    scored = []
    for k in kept:
        p = tails[k](float(real[k]))
        adjusted = max(family(-np.log(p)) / share, p)
        scored.append(Scored(keys[k], float(real[k]), p, min(adjusted, 1.0), float(np.mean(null[:, k]))))
    return tuple(sorted(scored, key=lambda s: (s.p, -s.statistic)))
