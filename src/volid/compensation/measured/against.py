"""A measured field against the kinematic model: does the model describe it, and where not (ISO/TR 16907 9.3.1, 11.3).

Judged at the measured places themselves, where nothing is interpolated: d = measured - model, of one tool vector, with

    V = readings + repeatability + scatter + G C Gᵀ,    M = V⁻¹ less what the unknown frame F of every station takes up,

M = V⁻¹ - V⁻¹ F (Fᵀ V⁻¹ F)⁻¹ Fᵀ V⁻¹, with the gradient G of the model's deviation and the covariance C of its parameters. A
solution
that was fitted to the same readings follows them: with W = V without the model and M_W made of it, M = M_W - M_W G C Gᵀ M_W, and
M y = M_W d for its residuals d. Tested are dᵀ M_W d over all places, and a shift b of every neighbourhood H against all other
places, b = (Hᵀ M H)⁻¹ Hᵀ M y, χ² = bᵀ (Hᵀ M H) b with three degrees of freedom (Baarda, A Testing Procedure for Use in Geodetic
Networks, 1968). Neighbourhoods are the nearest 4, 8, 16 and 32 places of every place. One counts where it stays significant when
all u are as large as the median place says, so that a u that is too small everywhere is not taken for a place where the model
fails. E_n = |b| / (2 u(b)) (as in ISO 13528:2015 9.7).

Not modelled: correlation of readings that share an instrument's systematic effect; errors smaller than a neighbourhood
and weaker than its u.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from volid.compensation.measured.field import MeasuredField
from volid.compensation.measured.points import MeasuredPoints
from volid.compensation.measured.process import Scale
from volid.compensation.residual.fields import field_over
from volid.compensation.residual.repeats import Repeats, repeats_of
from volid.exceptions import InputError
from volid.fitting.prediction.deviations import deviation_values
from volid.fitting.prediction.largest import Places
from volid.fitting.prediction.spread import covariance_root
from volid.fitting.solution import Solution

if TYPE_CHECKING:
    from jaxtyping import Float

LEVEL = 0.01  # probability of rejecting a model that is right, both tests together
NEAREST = (4, 8, 16, 32)  # places in a neighbourhood
LARGEST = 0.5  # of all places
FEWEST = 7  # places that a frame and something more are told from
NAMED = 5  # regions
MEDIAN = 2.366  # of χ² with three degrees of freedom
FOLLOWED = 0.999  # at most: share of a reading that a model follows
FOLLOWS = 1e-9  # of the readings: those of the solution are the same


class Region(NamedTuple):
    """A neighbourhood: `low`, `high` by axis letter [mm]; number of places; shift against all others (3,) [mm] and its u; χ² of
    the three components, and E_n, the largest of them."""

    low: dict[str, float]
    high: dict[str, float]
    places: int
    shift: np.ndarray
    u: np.ndarray
    chi_square: float
    normalised: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """Whether a kinematic model describes a measured field; `compare_field` makes it.

    Args:
        tool: The tool vector, (3,) [mm].
        positions: The places judged, shape (m, n_axes) [mm or degrees].
        difference: Measured - model, frames taken out, shape (m, 3) [mm].
        chi_square, degrees_of_freedom, probability: The test over all places.
        factor: Robust ratio of the differences to their u, place by place (1: as stated).
        regions: Where the model does not describe the field, the most significant first.
        same_readings: Whether the solution was fitted to these readings.
        left_out: Places outside what the solution was measured over.
    """

    tool: tuple[float, float, float]
    positions: Float[np.ndarray, "m axes"]
    difference: Float[np.ndarray, "m 3"]
    chi_square: float
    degrees_of_freedom: float
    probability: float
    factor: float
    regions: tuple[Region, ...]
    same_readings: bool
    left_out: int

    @property
    def describes(self) -> bool:
        """Whether the model describes the field."""
        return self.probability >= LEVEL / 2.0 and not self.regions

    @property
    def rms(self) -> float:
        """RMS length of the difference [mm]."""
        return float(np.sqrt((self.difference**2).sum(axis=1).mean()))

    @property
    def verdict(self) -> str:
        """One sentence."""
        if self.describes:
            return "the model describes the measured field"
        if not self.regions:
            size = max(self.factor, float(np.sqrt(self.chi_square / self.degrees_of_freedom)))
            return (
                f"the differences scatter from place to place by {size:.2f} times their u, but no region stands out: u is too "
                "small, or there are short waves or repeatability that nothing states"
            )
        worst = self.regions[0]
        box = ", ".join(f"{a} {worst.low[a]:.5g} … {worst.high[a]:.5g}" for a in worst.low)
        shift = ", ".join(f"{1e3 * v:+.2f}" for v in worst.shift)
        return (
            f"the model does not describe the measured field, most clearly at {box}: it shifts there by X, Y, Z {shift} µm "
            "against its surroundings"
        )


class _System(NamedTuple):
    """d̂ (3m,), frames taken out; M y (3m,) and M (3m, 3m); χ² over all places and its degrees of freedom."""

    difference: np.ndarray
    pulled: np.ndarray
    matrix: np.ndarray
    chi_square: float
    freedom: float


def compare_field(
    field: MeasuredField, solution: Solution, tool: tuple[float, float, float] | None = None
) -> Comparison:
    """Test whether a solution describes a measured field, for one tool vector.

    Args:
        field: A measured field, as `measured_field` makes it.
        solution: A solution of the same machine, as `volid.fit` makes it.
        tool: A measured tool vector, (3,) [mm]; the one with most places by default.

    Raises:
        InputError: another machine, or too few places within what the solution was measured over.
        NotDeterminedError: the solution's data do not determine the deviation for this tool vector.

    Source: ISO/TR 16907:2015 9.3.1, 11.3.

    >>> import numpy as np
    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> q = np.random.default_rng(1).uniform([50, 50, -450], [550, 950, -50], (60, 3))  # Y, X, Z
    >>> tool, still = np.tile([0.0, 0.0, -250.0], (60, 1)), np.zeros((60, 3))
    >>> tool[:, 0] = 80.0
    >>> read = q[:, [1, 0, 2]] + tool + solution.evaluate(q, tool).values[:, :3]
    >>> read += 0.001 * np.random.default_rng(2).standard_normal((60, 3))
    >>> points = volid.ObservationSet("t", "point", q, still, tool, read, still + 0.001, {"station": np.full(60, "T")})
    >>> campaign = volid.Campaign(solution.campaign.machine, (volid.Station("T"),), (points,))
    >>> volid.compare_field(volid.measured_field(campaign), solution).describes
    True
    """
    vector = np.asarray(field.tools[0] if tool is None else tool, dtype=float)
    points = field.points.of(field.points.with_tool(vector))
    if points.machine.structure != solution.machine.structure or points.machine.letters != solution.machine.letters:
        raise InputError(
            f"the field is of '{points.machine.name}' [{points.machine.structure}], the solution of '{solution.machine.name}' "
            f"[{solution.machine.structure}]; expected the same machine"
        )
    inside = np.flatnonzero(~solution.outside(points.positions) & solution.model.holds(points.positions))
    if len(inside) < FEWEST:
        raise InputError(
            f"{len(inside)} of {len(points)} measured places lie within what the solution was measured over; expected at least "
            f"{FEWEST}"
        )
    left_out, points = len(points) - len(inside), points.of(inside)
    same = follows(points, solution)
    system = _system(points, solution, vector, same)
    factor = _factor(system, len(points))
    from scipy.special import chdtrc

    return Comparison(
        (float(vector[0]), float(vector[1]), float(vector[2])), points.positions, system.difference.reshape(3, -1).T,
        system.chi_square, system.freedom, float(chdtrc(system.freedom, system.chi_square)), factor,
        _regions(points, system, factor), same, left_out,
    )  # fmt: skip


def follows(points: MeasuredPoints, solution: Solution) -> bool:
    """Whether the solution's campaign holds the readings that the places come from: the same positions with the same
    deviations."""
    from volid.compensation.measured.points import measured_points

    try:
        own = measured_points(solution.campaign)
    except InputError:
        return False
    table = {key: d for key, d in zip(_keys(own), own.deviation, strict=True)}
    keys = _keys(points)
    if not all(key in table for key in keys):
        return False
    theirs = np.array([table[key] for key in keys])
    shift = theirs - points.deviation  # another choice of places moves the frame alone
    return bool(np.abs(_without_frame(points, shift.T.ravel())).max() < 1e-6 + FOLLOWS * np.abs(theirs).max())


def _keys(points: MeasuredPoints) -> list[tuple[float, ...]]:
    return [tuple(row) for row in (np.round(np.hstack([points.positions, points.tool]), 6) + 0.0).tolist()]


def _without_frame(points: MeasuredPoints, values: np.ndarray) -> np.ndarray:
    columns = points.frame_columns(range(len(points.stations)))
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=1e-10)[0])


def _system(points: MeasuredPoints, solution: Solution, tool: np.ndarray, same: bool) -> _System:
    still = Places(points.positions, np.zeros_like(points.positions))
    plain = field_over(solution, still, tool)
    tools = np.broadcast_to(tool, (len(points), 3))
    theta = np.asarray(solution.parameters)
    model = deviation_values(solution.model, theta, still.positions, tools, still.directions)[:, :3]
    gradient = plain.gradient[:, :3].transpose(1, 0, 2).reshape(-1, len(theta))
    of_model = gradient @ solution.parameter_covariance @ gradient.T
    read = points.covariance + _scatter(points, solution, repeats_of(solution), tool)
    weights = read if same else read + of_model
    columns = points.frame_columns(range(len(points.stations)))
    columns = columns[:, np.abs(columns).max(axis=0) > 0.0]
    inverse = cho_solve(cho_factor(weights, lower=True), np.eye(len(weights)))
    solved = inverse @ columns
    normal = np.linalg.pinv(columns.T @ solved, rcond=1e-12, hermitian=True)
    matrix = inverse - solved @ normal @ solved.T
    difference = (points.deviation - model).T.ravel()
    pulled = matrix @ difference
    difference = difference - columns @ (normal @ (solved.T @ difference))
    chi_square, rank = float(difference @ pulled), np.linalg.matrix_rank(columns, tol=1e-9 * np.linalg.norm(columns))
    freedom = float(len(difference) - rank)
    if same:
        of_model = _followed(matrix, gradient @ covariance_root(solution.parameter_covariance / solution.factor**2))
        freedom -= float(np.sum(matrix * of_model))
        matrix = matrix - matrix @ of_model @ matrix
    return _System(difference, pulled, matrix, chi_square, freedom)


def _followed(matrix: np.ndarray, root: np.ndarray) -> np.ndarray:
    """G C Gᵀ (3m, 3m) from `root` G C½ (3m, r), at most as large as readings with the weights `matrix` leave it.

    C follows these readings, and so (C½)ᵀ Gᵀ M_W G C½ has eigenvalues below 1. A part of C that comes from elsewhere, such as
    what the smoothness is uncertain by, can pass that by a little.
    """
    sizes, vectors = np.linalg.eigh(root.T @ matrix @ root)
    root = root @ (vectors * np.sqrt(np.minimum(1.0, FOLLOWED / np.maximum(sizes, FOLLOWED))))
    return np.asarray(root @ root.T)


def _scatter(points: MeasuredPoints, solution: Solution, repeats: Repeats, tool: np.ndarray) -> np.ndarray:
    """Variances besides those of the readings: repeatability, and what the solution found to be independent from place to
    place."""
    places = Places(points.positions, np.zeros_like(points.positions))
    columns = repeats.columns(points.machine, places, tool)[:, :3]
    variance = (columns**2).sum(axis=2) + solution.scatter_u()[:3] ** 2
    return np.diag(variance.T.ravel())


def _shift(system: _System, rows: np.ndarray, m: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Shift b (3,) of some places against all others [mm], its u, and χ²."""
    three = [rows + k * m for k in range(3)]
    pulled = np.array([system.pulled[r].sum() for r in three])
    normal = np.array([[system.matrix[np.ix_(a, b)].sum() for b in three] for a in three])
    covariance = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    shift = covariance @ pulled
    return shift, np.sqrt(np.maximum(np.diag(covariance), 1e-300)), float(shift @ pulled)


def _factor(system: _System, m: int) -> float:
    """Robust unit weight: median over all places of χ² of their three components, over that of the distribution; at least 1."""
    squares = [_shift(system, np.array([i]), m)[2] for i in range(m)]
    return max(1.0, float(np.sqrt(np.median(squares) / MEDIAN)))


def _regions(points: MeasuredPoints, system: _System, factor: float) -> tuple[Region, ...]:
    """Neighbourhoods that shift against their surroundings, the most significant first, none of which overlap."""
    from scipy.spatial import KDTree
    from scipy.special import chdtri

    scale, m = Scale.of(points.positions), len(points)
    x = scale(points.positions)
    _, order = KDTree(x).query(x, k=min(max(NEAREST), m))
    sizes = [k for k in NEAREST if k <= LARGEST * m]
    near = {tuple(sorted(row[:k].tolist())) for k in sizes for row in order}
    tested = [(np.array(rows), *_shift(system, np.array(rows), m)) for rows in sorted(near)]
    limit = float(chdtri(3, LEVEL / 2.0 / max(len(tested), 1))) * factor**2
    found: list[Region] = []
    taken: set[int] = set()
    for rows, shift, u, chi_square in sorted(tested, key=lambda t: -t[3]):
        if chi_square <= limit or len(found) == NAMED:
            break
        if not taken & set(rows.tolist()):
            taken |= set(rows.tolist())
            found.append(_region(points, scale, (rows, shift, u, chi_square)))
    return tuple(found)


def _region(points: MeasuredPoints, scale: Scale, tested: tuple[np.ndarray, np.ndarray, np.ndarray, float]) -> Region:
    rows, shift, u, chi_square = tested
    q = points.positions[rows]
    low, high = ({points.machine.letters[i]: float(end(q[:, i])) for i in scale.columns} for end in (np.min, np.max))
    return Region(low, high, len(rows), shift, u, chi_square, float((np.abs(shift) / (2.0 * u)).max()))
