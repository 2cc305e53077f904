"""Which engine serves a piece of work: decided here alone, by the processor time of all of it, compiling included.

Measured on two cores of an AMD EPYC, JAX 0.10, in seconds of processor time; `fit` alone, splines chosen from the data.

| fit | interpreted | compiled, first ever | compiled, programs in JAX's cache |
|---|---|---|---|
| 12,825 readings of an R-test on two rotary axes | 1.1 | 26 to 40 | 8.8 |
| 20,000 distances | 2.4 | 24.9 | 8.9 |
| 100,000 distances | 5.4 | 29.4 | 11.7 |
| 1,000,000 distances | 41 | | |
| 1,000,000: one JᵀJ in double, in single precision, one gradient | 1.9, 1.6, 0.74 | | 2.0, 1.3, 0.51 |

So the programs of a fit cost `COMPILING`; tracing and loading, which no cache saves, a quarter of that. A fit forms some six
JᵀJ and six gradients, of which compiled programs save `SAVED` per reading: NumPy's products are the same BLAS in the same tiles.
The rule takes the first fit, with an empty cache: nobody should wait longer for the first fit than for the next. The command line
keeps programs in a cache (`cli.environment`), Python keeps them in the process. Rotary axes make programs longer to compile, so
compiling pays later still. A whole fit of a million readings was not run compiled.
"""

from __future__ import annotations

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.equations.compiled import Compiled
from volid.fitting.equations.engine import Engine
from volid.fitting.equations.interpreted import Interpreted

COMPILING = 22.0  # s of processor time, programs of a fit
SAVED = 2e-6  # s of processor time per reading and fit that compiled programs save
REFITS = 5  # times that a robust fit solves as often as a plain one, with leverages
POINTS = 20_000  # deviations at so many points take NumPy less time than tracing their program

COMPILED, INTERPRETED = "compiled", "interpreted"


def engine_named(name: str) -> Engine:
    """The engine of that name. Raises `InputError` for an unknown one."""
    if name == COMPILED:
        return Compiled()
    if name == INTERPRETED:
        return Interpreted()
    raise InputError(f"engine is '{name}'; expected '{COMPILED}' or '{INTERPRETED}'")


def engine_for_compiled_solver(name: str | None) -> Engine:
    """The engine for a solver that is a compiled program itself. Raises `InputError` when another engine is named."""
    engine = engine_named(COMPILED if name is None else name)
    if engine.name != COMPILED:
        raise InputError(f"engine is '{name}', but this solver is a compiled program; expected '{COMPILED}' or none")
    return engine


def _pays(n_readings: int, fits: int) -> bool:
    """Whether compiled programs save more than they cost: from 11 million readings on, in a robust fit from 2 million."""
    return n_readings * fits * SAVED > COMPILING


def engine_for_fit(campaign: Campaign, *, robust: bool = False) -> Engine:
    """The engine for a whole fit of a campaign."""
    return Compiled() if _pays(campaign.n_readings, REFITS if robust else 1) else Interpreted()


def engine_for_stream(n_readings: int) -> Engine:
    """The engine for a fit that reads a stream of so many readings part by part."""
    return Compiled(tiles=False) if _pays(n_readings, 1) else Interpreted()


def engine_for_trials(robust: bool) -> Engine:
    """The engine for full refits of single trials: few of a plain Monte Carlo need one, all of a robust one may."""
    return Compiled() if robust else Interpreted()


def engine_for_readings(campaign: Campaign) -> Engine:
    """The engine for predicting the readings of a campaign twice, as a simulation does: less than two gradients."""
    return Compiled() if _pays(campaign.n_readings // 6, 1) else Interpreted()


def engine_for_points(m: int) -> Engine:
    """The engine for deviations at so many points, in one question."""
    return Interpreted() if m <= POINTS else Compiled()
