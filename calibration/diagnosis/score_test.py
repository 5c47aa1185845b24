"""One score test of effects, covariates and odd presses, at one level.

A direction d is the change of the force that an effect would bring (from each of its starts), or a step function
of a covariate. Whitened and orthogonal to what the fit can absorb, its score is t = d.z/|d|. Since changes from
press to press otherwise count as scatter, t^2 is a likelihood ratio in which presses may scatter less with the
direction than without it (`Cast.ratios`). Of an effect the largest t^2 over its starts counts; of a press's
covariate the largest of a step, a line and a parabola; of a sample's covariate the sum over its bins. The scatter
of loading, the press farthest from its like and the wander of presses' zeros are tested as well. All are compared
with one parametric bootstrap, in which samples and presses are sampled with their own tails and the error model is
estimated anew. An allowance for the form of effects in the model (`form_errors`) is part of the fit. The level is
shared: effects have `SHARE` of it, everything else the rest, each by its smallest p; p_adjusted is adjusted for
all tests.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.diagnosis.covariates import covariate_steps, form_errors, press_terms
from calibration.diagnosis.score_statistics import Cast, Tail
from calibration.diagnosis.sensitivity import added_force, smallest_visible
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.least_squares import Fit
from calibration.fit.outlying_presses import PressLooks
from calibration.fit.repeats import LEVEL, renewed_noise
from calibration.inputs.deadline import Each, in_turn
from calibration.inputs.observations import Observations
from calibration.model.stages import Effect
from calibration.noise.model import Noise, Scatter
from tactilevision.records.measured import Floats

DRAWS = 399  # samples of the bootstrap: p to .0025, finer by the tail's fit
FIRST_DRAWS = 99  # after which it ends where all is decided
MANY_DRAWS = 1999  # where p lies near a level: with heavy tails p of 399 varied 300 times, of these 3
NEAR_LEVELS = (1e-5, 0.2)  # p between which more samples may decide otherwise
PORTION = 300  # samples made at once
PORTION_VALUES = 4_500_000  # forces made at once, 36 MB
BATCH = 50  # samples of one step, which any process may do: .2 s for 1600 forces
FAR_FROM = 4  # times the level: p of 99 samples above it means p above the level but for 1 in 1e7
QUICK_NEAR = 2  # times the level: p of 99 samples within it may lie on the other side
SHARE = 0.6  # share of the level that effects have
SCATTER = "scatter while loading"

LESS = (1, 0.03, 0.12, 0.4)  # factors of the presses' estimated gain that are tried
MORE = (2, 4)  # as well, where presses are too few to determine it
FEW_PRESSES = 12  # curves; fewer hardly determine the scatter of presses
FEW_POINTS = 24  # points; one reading a press

_Rows = tuple[Floats, Floats, Floats]  # scores (b, k), scatter while loading (b, M'), what presses say (b, q)


class Failure(str):
    """The reason that an effect cannot be tested: it raised an error."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Scored:
    """One effect or covariate: its statistic, its own p, and p adjusted for all tests.

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
    """The scores of effects and of covariates, the most significant first, and why others were not tested.

    `others` are what is odd among presses; `visible` is the minimum detectable amplitude of
    each effect's first parameter at 80 % power, inf where the base model absorbs it.
    """

    effects: tuple[Scored, ...]
    covariates: tuple[Scored, ...]
    not_testable: Mapping[str, str]
    visible: Mapping[str, float]
    others: tuple[Scored, ...] = ()

    @property
    def lack_of_fit(self) -> float:
        """The smallest adjusted p of all but effects; 1 where there is none."""
        return min((c.p_adjusted for c in (*self.covariates, *self.others)), default=1.0)

    @property
    def family_p(self) -> float:
        """The smallest adjusted p of all tests."""
        return min([self.lack_of_fit, *(s.p_adjusted for s in self.effects)])


def score_test(
    fitted: Fit,
    effects: Sequence[Effect],
    *,
    rng: np.random.Generator,
    draws: int = DRAWS,
    of_rig: bool = False,
    quick: bool = False,
    each: Each = in_turn,
) -> ScoreTest:
    """Score `effects` and every covariate on the residual of `fitted`, whose noise is taken as its own.

    With `of_rig` odd presses are scored as well. `quick`: more samples than the first only where p is near the
    level.
    """
    fitted = at_denoised_depth(fitted)
    tables, missing = effect_directions(fitted, effects)
    of_presses, steps = press_terms(fitted), covariate_steps(fitted)
    cast = Cast(fitted, [*tables.values(), *of_presses.values(), *steps.values()], form_errors(fitted))
    for key, table in zip(tables, cast.left[: len(tables)], strict=True):
        if not table.any():
            missing[key] = "the base model absorbs it: these data cannot distinguish it from E, nu or beta"
    looks = _Looks(cast, fitted, searched=len(tables) + len(of_presses), of_rig=of_rig)
    few = scatter_unknown(fitted.data)
    keys = [*tables, *of_presses, *steps, *looks.names]
    rows = [looks.own(), *looks.drawn(rng, min(FIRST_DRAWS, draws), each)]
    table = looks.table(rows)
    found = _family(keys, table, len(tables), missing)
    undecided = [(draws, (0.0, FAR_FROM * LEVEL)), (MANY_DRAWS if draws >= DRAWS else draws, NEAR_LEVELS)]
    if quick:
        undecided = [(draws, (LEVEL / QUICK_NEAR, LEVEL * QUICK_NEAR))]
    for enough, (low, high) in undecided:
        smallest = min((s.p_adjusted for part in found for s in part), default=1.0)
        if len(table) <= enough and low <= smallest < high:
            rows += looks.drawn(rng, enough + 1 - len(table), each)
            table = looks.table(rows)
            found = _family(keys, table, len(tables), missing)
    named, rest, of_residual = *found, {*of_presses, *steps, SCATTER}
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
    """Return whether these are curves of so few presses that changes between them count as scatter."""
    return data.is_curves and data.count < FEW_PRESSES


def scatter_unknown(data: Observations) -> bool:
    """Return whether presses are too few to determine how they scatter."""
    return few_presses(data) or (not data.is_curves and data.count < FEW_POINTS)


def _family(
    keys: Sequence[str], table: Floats, effects: int, missing: Mapping[str, str]
) -> tuple[tuple[Scored, ...], tuple[Scored, ...]]:
    """Return the scores of the effects, the first so many statistics, and of the rest, by their level's shares."""
    share = SHARE if effects else 0.0
    parts = ((slice(0, effects), share), (slice(effects, None), 1 - share))
    named, rest = (_ranked(keys[part], table[:, part], skip=missing, share=own) for part, own in parts)
    return named, rest


class _Looks:
    """All statistics of one fit: largest squared score of an effect or a press's covariate, sum of a sample's
    covariate, scatter of loading, and with `of_rig` the presses; `names` of the last two.
    """

    def __init__(self, cast: Cast, fitted: Fit, *, searched: int, of_rig: bool) -> None:
        self._cast, self._fitted, self._searched = cast, fitted, searched
        self._gains = (*LESS, *MORE) if scatter_unknown(fitted.data) else LESS
        self._scatter = Scatter(fitted.data)
        self._presses = PressLooks(fitted) if of_rig else None
        self.names = [*([SCATTER] if self._scatter.seen else []), *(self._presses.names if self._presses else [])]

    def own(self) -> _Rows:
        """Return the statistics of the residual itself."""
        return self._part(self._fitted.residual_N[:, None], self._cast.own_priors[:, None], [self._fitted.noise])

    def drawn(self, rng: np.random.Generator, draws: int, each: Each) -> list[_Rows]:
        """Return those of so many bootstrap samples, made in portions; a batch is one step."""
        most, rows = max(1, min(PORTION, int(PORTION_VALUES / self._fitted.data.size))), []
        for begin in range(0, draws, most):
            errors, priors = self._cast.null(rng, min(most, draws - begin))
            cuts = np.arange(0, errors.shape[1], BATCH)[1:]
            given = list(zip(np.split(errors, cuts, axis=1), np.split(priors, cuts, axis=1), strict=True))
            rows += [fetch() for fetch in each(self._drawn, given)]
        return rows

    def table(self, rows: Sequence[_Rows]) -> Floats:
        """Return statistics (1 + draws, n) of the residual, first of `rows`, and of the bootstrap samples."""
        scores, loading, presses = (np.concatenate(part) for part in zip(*rows, strict=True))
        if not self._scatter.seen:
            return np.hstack([scores, presses])
        usual = float(np.mean([one.mean() for one in loading[1:]]))
        scattered = np.array([self._scatter.statistic(one, usual) for one in loading])
        return np.column_stack([scores, scattered, presses])

    def _drawn(self, given: tuple[Floats, Floats]) -> _Rows:
        """Return `_part` of sampled errors (N, b) and priors (k, b), each under the noise estimated anew."""
        return self._part(*given, renewed_noise(self._fitted, given[0]))

    def _part(self, errors: Floats, priors: Floats, noises: Sequence[Noise]) -> _Rows:
        """Return scores (b, k), excess scatter of presses while loading (b, M'), statistics of presses (b, q)."""
        count, most = len(noises), self._searched
        ratios, white = self._cast.ratios(noises, errors, priors, gains=self._gains)
        columns = [
            *(np.max(one, axis=1, initial=0.0) for one in ratios[:most]),
            *(np.sum(one, axis=1) for one in ratios[most:]),
        ]
        scores = np.array(columns).reshape(-1, count).T
        loading, presses = np.zeros((count, 0)), np.zeros((count, 0))
        if self._scatter.seen:
            loading = self._scatter.differences(white).T
        if self._presses is not None:
            presses = self._presses.statistics(self._cast.left_of(errors, priors)).T
        return scores, loading, presses


def effect_directions(fitted: Fit, effects: Sequence[Effect]) -> tuple[dict[str, Floats], dict[str, str]]:
    """Return the change of the force (N, s) for each start of each testable effect, and why others are not."""
    tables: dict[str, Floats] = {}
    missing: dict[str, str] = {}
    data = fitted.data
    for effect in effects:
        if effect.key in fitted.model.keys:
            continue
        try:
            why = effect.unfit(data) or effect.missing(data)
            if not why:
                changes = [added_force(fitted, effect, start, data) for start in effect.starts(data)]
                tables[effect.key] = np.column_stack(changes)
        except (Exception, SystemExit) as fault:  # of a private effect, anything; the rest of the analysis goes on
            why = Failure(f"it failed: {type(fault).__name__}: {fault}")
        if why:
            missing[effect.key] = why
    return tables, missing


def _ranked(keys: Sequence[str], table: Floats, *, skip: Mapping[str, str], share: float) -> tuple[Scored, ...]:
    """Return p of each statistic, and p adjusted for the smallest of all and for the `share` of the level.

    The first row of `table` holds the real statistics, the others bootstrap samples.
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
