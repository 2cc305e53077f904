"""Who determines what: for every set and every function, what the campaign would know without the set, and from it alone.

What is determined is decided on the geometry of the readings, as in a fit (`diagnosis.identifiability`), with the readings of
some sets left out, and every set's own unknowns (stations, offsets, alignments) eliminated. Combinations are counted at the
positions of the readings, smoothness not counted as knowledge: eleven positions along an axis tell ten of a fine spline. What
only a tilt of an artefact or a beam shows counts too, however large its u. u without a set follows from the normal equations of
the others at the solution, with the smoothness of functions as it was estimated from all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from volid.backend.threads import one_blas_thread
from volid.campaign import Campaign, ObservationSet
from volid.effects.prediction import groups_of
from volid.exceptions import InputError
from volid.fitting.change_of_datum import EXTRAPOLATED
from volid.fitting.diagnosis.identifiability import Identifiability
from volid.fitting.equations.choice import engine_named
from volid.fitting.equations.problem import Prior, Problem, build_problem, reweight, with_prior, with_random_effects
from volid.fitting.equations.solver import optimum_at
from volid.fitting.fitter import Fitter
from volid.fitting.smoothness.geometry import count_determined, determined
from volid.fitting.smoothness.processes import processes_of
from volid.fitting.smoothness.scatter import with_scatter
from volid.fitting.solution import Solution
from volid.model.iso230 import parse
from volid.observations.base import NuisanceTable

POINTS = 21  # positions of a function at which its largest u is looked for
LARGER = 1.1  # u without a set over u with it, from which on the set is said to matter


@dataclass(frozen=True)
class Determined:
    """What a set determines. Combinations are of the parameters of the error model, of which there are `parameters`.

    Args:
        set: The set.
        parameters: Parameters of the error model.
        together: Combinations that all sets together determine.
        by_itself: Combinations that the set alone determines, with what is known of it and from an earlier solution.
        only: Combinations that no other set determines: those of `together` that are lost without the set.
        functions: Error functions that are wholly determined by all sets, and not without this one.
    """

    set: str
    parameters: int
    together: int
    by_itself: int
    only: int
    functions: tuple[str, ...]


@dataclass(frozen=True)
class Share:
    """What a set contributes to one error function or location error.

    Args:
        function: ISO 230-1 symbol.
        set: The set.
        unit: mm or rad.
        u: Largest standard uncertainty of the function from all sets; NaN where it is not determined.
        u_without: The same without the set.
        u_alone: The same from the set alone.
    """

    function: str
    set: str
    unit: str
    u: float
    u_without: float
    u_alone: float

    @property
    def matters(self) -> bool:
        """Whether the function would be known less well without the set."""
        return not self.u_without < LARGER * self.u and bool(np.isfinite(self.u))


@dataclass(frozen=True)
class WhoDetermines:
    """The table of who determines what.

    Args:
        sets: One row for every set.
        shares: One row for every function and set.

    >>> rows = Determined("bar", 72, 72, 20, 0, ()), Determined("station", 72, 72, 44, 31, ("EAZ",))
    >>> share = Share("EAZ", "station", "rad", 2e-6, float("nan"), 4e-6)
    >>> WhoDetermines(rows, (share,)).share("EAZ", "station").matters
    True
    """

    sets: tuple[Determined, ...]
    shares: tuple[Share, ...]

    def share(self, function: str, name: str) -> Share:
        """That of set `name` in one function (KeyError where there is none)."""
        return {(s.function, s.set): s for s in self.shares}[function, name]


@one_blas_thread()
def who_determines(solution: Solution) -> WhoDetermines:
    """Who determines what: every set of a campaign, left out and alone, against all sets together.

    Not told: what two sets that are both left out would leave open; what a set contributes by its station to the readings of
    another set that uses it (the station is then unknown to the others, too); what an earlier solution determines without any
    set.

    Args:
        solution: A solution, as `volid.fit` makes it.

    Raises:
        InputError: the solution does not hold all readings that it was made of, or was extrapolated.

    Source: ISO/TR 16907 8; Koch, Parameter Estimation and Hypothesis Testing in Linear Models, 1999, 3.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> found = volid.who_determines(solution)
    >>> [(row.set, row.by_itself, row.only, row.functions) for row in found.sets]
    [('X', 41, 41, ('EXX',)), ('Z', 27, 27, ('EZZ',))]
    """
    for option in (EXTRAPOLATED, "streamed"):
        if option in solution.options:
            raise InputError(
                f"who determines what needs all readings of a fit, but this solution is {option}; take one that holds them"
            )
    views = _Views(solution)
    whole, sets, shares = views.whole(), [], []
    for i, readings in enumerate(solution.campaign.sets):
        own = np.arange(len(solution.campaign.sets)) == i
        without, alone = views.view(~own), views.view(own)
        n, together = solution.model.n_parameters, whole.rank
        lost = tuple(f for f in whole.known if f not in without.known)
        sets.append(Determined(readings.name, n, together, alone.rank, together - without.rank, lost))
        shares += [
            Share(f, readings.name, views.units[f], whole.u[f], without.u[f], alone.u[f]) for f in solution.model.names
        ]
    return WhoDetermines(tuple(sets), tuple(shares))


@dataclass(frozen=True)
class _View:
    """What some of the sets say: `rank`, number of combinations that they determine; `u` by function, NaN where it is not."""

    rank: int
    u: dict[str, float]

    @property
    def known(self) -> tuple[str, ...]:
        """Functions that are wholly determined."""
        return tuple(f for f, u in self.u.items() if np.isfinite(u))


class _Views:
    """A solution's problem, looked at with some of its sets."""

    def __init__(self, solution: Solution) -> None:
        self.solution, engine = solution, engine_named("interpreted")
        table = NuisanceTable.of(solution.nuisance_table)
        starts = {entry.key: entry.start for entry in solution.nuisance_table}
        campaign = with_random_effects(solution.campaign, starts, engine)
        earlier = solution.prior_root
        rows = np.zeros((0, solution.model.n_parameters)) if earlier is None else np.asarray(earlier)
        self.known = Prior(np.zeros(len(rows)), rows)
        self.problem = build_problem(campaign, solution.model, prior=self.known, table=table, engine=engine)
        self.z = np.concatenate([solution.model.parametrisation @ solution.parameters, np.asarray(solution.nuisance)])
        if solution.scatter:
            campaign = with_scatter(campaign, self.problem, self.z, solution.scatter)
        self.campaign = campaign
        self.processes = processes_of(solution.model, solution.smooth_functions) if solution.smooth is not None else ()
        self.seen: dict[tuple[bool, ...], _View] = {}
        self.units = {f: parse(f).unit for f in solution.model.names}

    def whole(self) -> _View:
        """With all sets: what the solution says."""
        factors = [np.where(o, 0.0, 1.0) for o in self.solution.readings.outliers]
        return _View(count_determined(self.campaign, self.problem, self.known, factors), _largest_u(self.solution))

    def view(self, used: np.ndarray) -> _View:
        """With the sets `used`, bool (sets,), and none of the readings that the fit set aside."""
        key = self._speaking(used)
        if key not in self.seen:
            self.seen[key] = self._view(key)
        return self.seen[key]

    def _speaking(self, used: np.ndarray) -> tuple[bool, ...]:
        """`used` less the sets that say nothing without the others: a level on an artefact that no line is read on."""
        kept = replace(self.campaign, sets=tuple(s for s, u in zip(self.campaign.sets, used, strict=True) if u))
        return tuple(bool(u) and self._speaks(s, kept) for s, u in zip(self.campaign.sets, used, strict=True))

    def _speaks(self, readings: ObservationSet, campaign: Campaign) -> bool:
        try:
            groups_of(readings, campaign, NuisanceTable.of(self.problem.nuisance))
        except InputError:  # all sets together were fitted: what is wrong is that others are missing
            return False
        return True

    def _view(self, used: tuple[bool, ...]) -> _View:
        aside = self.solution.readings.outliers
        factors = [np.where(o, 0.0, 1.0) * float(u) for o, u in zip(aside, used, strict=True)]
        if not any(used):
            return _View(0, dict.fromkeys(self.units, float("nan")))
        problem = reweight(self.problem, self.campaign, factors)
        found = determined(self.campaign, problem, self.known, self.processes, factors)
        seen = replace(
            self.solution,
            covariance=self._covariance(problem, found),
            null_space=found.null_space,
            held_directions=found.tool_rotation,
        )
        return _View(count_determined(self.campaign, problem, self.known, factors), _largest_u(seen))

    def _covariance(self, problem: Problem, found: Identifiability) -> np.ndarray:
        """Covariance of (θ, ν) from the readings that take part, as the solution has it from all."""
        solution, n = self.solution, self.solution.model.n_parameters
        fitter = Fitter(self.campaign, with_prior(problem, self.known.and_smooth(solution.smooth_rows)), found)
        if not fitter.free.shape[1]:
            return np.zeros((len(solution.covariance), len(solution.covariance)))
        fitter.optimum = optimum_at(fitter.problem, self.z, 0.0, fitter.free, 0, True)
        whole, layout = fitter.root(), problem.model.layout
        root = np.vstack([problem.model.projection @ whole[: layout.n_coefficients], whole[layout.n_coefficients :]])
        if solution.smooth is not None and solution.smooth.noise.size:
            spread = root @ (root[:n].T @ (solution.smooth_rows.T @ solution.smooth.noise))
            root = np.hstack([root, spread])
        return np.asarray(solution.factor**2 * root @ root.T)


def _largest_u(solution: Solution) -> dict[str, float]:
    """Largest u of every function; NaN where it is not wholly determined."""
    largest: dict[str, float] = {}
    for row in solution.functions(points=POINTS):
        largest[row.name] = float(np.maximum(largest.get(row.name, 0.0), row.u))
    return largest
