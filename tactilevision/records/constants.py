"""Numbers that several files use, each stated once: levels, prefixes of units, guards, and a silicone's nu."""

from __future__ import annotations

Z95 = 1.96  # standard deviations to either side that hold 95 % of a normal distribution
Z90 = 1.645  # standard deviations above which 5 % of a normal distribution lies: a one-sided 95 % limit
KILO = 1e3  # m to mm, N to mN, s to ms
MILLI = 1 / KILO  # mm to m, mN to N, ms to s
MICRO = MILLI**2  # um to m, uN to N, us to s
ROUNDING = 1e-9  # relative tolerance for sums and products of floats
TAILS95 = (0.025, 0.975)  # quantiles at the ends of a 95 % interval
NONZERO = 1e-300  # keeps a norm or a probability from zero without changing any other
TINY = 1e-9  # keeps a denominator from zero; far below every length in mm, force in N and time in s here

NU_SILICONE = (0.45, 0.4999)  # Poisson's ratio of silicones: the range where nothing states it
NU_NOMINAL = 0.48  # Poisson's ratio at which a curve is computed where nothing states it; E then stays open
NU_MAX = NU_SILICONE[1]  # the highest that tables and solvers take: a bonded layer of .5 has no finite stiffness
