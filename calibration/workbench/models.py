"""Models as `compare` fits them, each fitted once: going back to one costs nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.excluded_presses import leave_out
from calibration.inputs.observations import Observations
from calibration.model.stages import Effect
from calibration.tasks.compare import (
    Comparison,
    Prepared,
    plain_law,
    prepare,
    with_covariates,
    with_effect,
    with_gel,
)
from calibration.workbench.opened import Opened


@dataclass(frozen=True, slots=True)
class Fitted:
    """The plain law and each effect on top of those before; `ready` what they are fitted to.

    `rng` is where the draws of these models ended: the next effect's go on from a copy, as in `compare`. None:
    what the residual depends on was not looked for yet.
    """

    found: Comparison
    ready: Prepared
    rng: np.random.Generator | None = None

    @property
    def refused(self) -> tuple[tuple[str, str], ...]:
        """Effects that could not be added, and why."""
        return self.found.left_out


class Models:
    """The models of one analysis; each prefix of effects is fitted once."""

    def __init__(self, opened: Opened, seed: int = 0) -> None:
        self._opened, self._seed = opened, seed
        self._anew: dict[str, Mapping[str, Observations]] = {}
        self._known: dict[tuple[tuple[str, ...], tuple[str, ...]], Fitted] = {}

    def fitted(self, left_out: Sequence[str], keys: Sequence[str]) -> Fitted:
        """The plain law with these effects in this order, and at first without what it says of the gel, and what
        its residual depends on.

        Raises InputError where the law cannot be fitted.
        """
        place = (tuple(sorted(left_out)), tuple(keys))
        if place not in self._known:
            if keys:
                before = self.fitted(place[0], keys[:-1])
                self._known[place] = self._with(before, self._opened.effect(keys[-1]), place[0])
            else:
                self._known[place] = self._plain(place[0])
        return self._known[place]

    def with_covariates(self, left_out: Sequence[str], keys: Sequence[str]) -> Fitted:
        """The same with what the residual of each model depends on; draws follow one another as in `compare`."""
        quick = self.fitted(left_out, keys)
        if quick.rng is not None:
            return quick
        before = self.with_covariates(left_out, keys[:-1]) if keys else None
        rng = np.random.default_rng(self._seed) if before is None else deepcopy(before.rng)
        assert rng is not None
        known = () if before is None else before.found.models
        models = [
            replace(one, covariates=known[k].covariates) if k < len(known) else one
            for k, one in enumerate(quick.found.models)
        ]
        found = replace(quick.found, models=tuple(models))
        found = with_covariates(found, rng) if len(models) > len(known) else found
        place = (tuple(sorted(left_out)), tuple(keys))
        self._known[place] = replace(quick, found=found, rng=rng)
        return self._known[place]

    def with_gel(self, left_out: Sequence[str], keys: Sequence[str]) -> Fitted:
        """The same with what it says of the gel."""
        quick = self.fitted(left_out, keys)
        if any(model.material is None for model in quick.found.models):
            self._known[tuple(sorted(left_out)), tuple(keys)] = replace(quick, found=with_gel(quick.found))
        return self.fitted(left_out, keys)

    def _plain(self, left_out: Sequence[str]) -> Fitted:
        data = leave_out(self._opened.data, left_out)
        ready = prepare(data, bulge=self._opened.bulge, bound=self._opened.bound)
        return Fitted(plain_law(ready, rng=None, of_gel=False), ready)

    def _with(self, before: Fitted, effect: Effect, left_out: Sequence[str]) -> Fitted:
        ready = before.ready
        asked = str(getattr(effect, "treatment", ""))
        if asked:
            if asked not in self._anew:
                self._anew[asked] = self._opened.read_anew(effect)
            again = {name: leave_out(data, left_out) for name, data in self._anew[asked].items()}
            ready = replace(ready, treated={**ready.treated, **again})
        return Fitted(with_effect(before.found, effect, ready, rng=None, of_gel=False), ready)
