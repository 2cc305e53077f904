"""The evaluation of sequential step diagonals: the nine functions' quantities, what contradicts them, what may have leaked in."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import chdtrc

from volid.backend.consent import ask
from volid.campaign import Campaign, ObservationSet
from volid.model.iso230 import LINEAR_AXES
from volid.standards.results import Evaluation, Quantity, Table
from volid.standards.shared_errors import corrections
from volid.standards.step_diagonals.separation import NAMES, NineFunctions, separate
from volid.standards.step_diagonals.steps import steps_of

STANDARD = "sequential step diagonals"
K = 2.0
LARGE = 1.0  # mm: a function that is larger is asked about
CHANCE = 0.05  # of an attention where nothing but noise is in the readings
# Squareness in the datum of X primary, Y secondary: minus or plus the sum of the slopes of two functions (CONVENTIONS 3)
SQUARENESS = {"EC0Y": (-1.0, "Dx(y)", "Dy(x)"), "EB0Z": (1.0, "Dx(z)", "Dz(x)"), "EA0Z": (-1.0, "Dy(z)", "Dz(y)")}
LEAKY = (
    "rotations of the axes and a mirror that is not square to its beam leak into the nine functions, and the four diagonals "
    "hardly show it; the rotations themselves, from a solution or a simulation, tell by how much"
)
ONE_WAY = (
    "the steps were not read in both senses: where reversal changes along an axis, half of that change is in the nine "
    "functions"
)


def evaluate_step_diagonals(observations: ObservationSet, campaign: Campaign) -> Evaluation:
    """The nine functions of a set, with the slopes and straightness that they split into.

    Quantities: `Dx(x)` …: range of each function; `EYX` …: range of the straightness alone, its least-squares line removed;
    `EC0Y`, `EB0Z`, `EA0Z`: squareness, X primary and Y secondary axis. U from u of the readings and the set's effects (k = 2);
    it does not hold what leaked in.

    Args:
        observations: A set of kind `projection` along body diagonals.
        campaign: The campaign that it belongs to.

    Raises:
        InputError: the set holds no steps of single axes; a function exceeds a millimetre, outside `accept_unusual`.
        NotDeterminedError: its diagonals do not determine the nine functions.
    """
    nine = separate(steps_of(observations, campaign))
    _ask_size(nine)
    return Evaluation(
        standard=STANDARD,
        subject=observations.name,
        quantities=(*_ranges(nine), *_straightness(nine), *_squareness(nine)),
        remarks=tuple(_remarks(nine)),
        attention=tuple(_contradiction(nine)),
        table=_table(nine),
        source=observations.source,
        details=nine,
    )


def _ask_size(nine: NineFunctions) -> None:
    """Raises `InputError` for functions that are no machine's, outside `accept_unusual`: the steps were others than said."""
    sizes = {name: float(np.abs(nine.of(name)[1]).max()) for name in NAMES}
    largest = max(sizes, key=lambda name: sizes[name])
    if sizes[largest] > LARGE:
        ask(
            f"{nine.steps.observations.file_and_set}: {largest} reaches {sizes[largest]:.4g} mm. Expected readings in mm of "
            "steps between the positions that are stated, in the stated order (of a table X, Y, Z): are box, steps and unit "
            "those of the test?"
        )


def _ranges(nine: NineFunctions) -> Iterator[Quantity]:
    for i, name in enumerate(NAMES):
        axis, c = divmod(i, 3)
        what = "positioning" if axis == c else "straightness and squareness"
        text = f"range of the motion in {LINEAR_AXES[c]} along {LINEAR_AXES[axis]}: {what}"
        yield _range(nine, name, nine.maps[axis][:, c], text)


def _range(nine: NineFunctions, name: str, rows: np.ndarray, text: str) -> Quantity:
    """Largest minus smallest value of `rows` · readings."""
    values = rows @ nine.steps.beyond_nominal
    apart = rows[np.argmax(values)] - rows[np.argmin(values)]
    return Quantity(name, float(np.ptp(values)), "mm", K * float(np.sqrt(nine.variance(apart))), text=text)


def _straightness(nine: NineFunctions) -> Iterator[Quantity]:
    for axis, letter in enumerate(LINEAR_AXES):
        x = nine.steps.nodes[axis]
        line = np.stack([np.ones_like(x), x - x.mean()], axis=1)
        without = np.eye(len(x)) - line @ np.linalg.pinv(line)
        for c, direction in enumerate(LINEAR_AXES):
            if c != axis:
                text = f"straightness of {letter} in {direction}, least-squares line removed"
                yield _range(nine, f"E{direction}{letter}", without @ nine.maps[axis][:, c], text)


def slope_rows(nine: NineFunctions, name: str) -> np.ndarray:
    """What the least-squares slope of a function takes from each reading, (m,) [1/mm]."""
    axis, c = divmod(NAMES.index(name), 3)
    lever = nine.steps.nodes[axis] - nine.steps.nodes[axis].mean()
    return np.asarray(lever @ nine.maps[axis][:, c] / (lever @ lever))


def _squareness(nine: NineFunctions) -> Iterator[Quantity]:
    for symbol, (sign, one, other) in SQUARENESS.items():
        rows = sign * (slope_rows(nine, one) + slope_rows(nine, other))
        text = f"squareness, {'minus ' if sign < 0 else ''}the slopes of {one} and {other}"
        value = float(rows @ nine.steps.beyond_nominal)
        yield Quantity(symbol, value, "rad", K * float(np.sqrt(nine.variance(rows))), text=text)


def _remarks(nine: NineFunctions) -> Iterator[str]:
    steps = nine.steps
    counts = ", ".join(f"{len(q) - 1} of {a}" for a, q in zip(LINEAR_AXES, steps.nodes, strict=True))
    yield f"least squares over {len(steps.axis)} steps on {len(steps.lines)} diagonals, {counts}"
    found, noise, _, _ = contradiction(nine)
    yield (
        f"the diagonals contradict each other by {1e3 * found:.2f} µm RMS per step, where readings of this u give "
        f"{1e3 * noise:.2f} µm"
    )
    yield from corrections(steps.observations)
    yield from steps.campaign.warnings
    yield LEAKY
    if not steps.both_senses:
        yield ONE_WAY


def contradiction(nine: NineFunctions) -> tuple[float, float, float, int]:
    """What the diagonals leave, and what noise alone would: RMS both [mm]; chi-square and its degrees of freedom."""
    squares, dof = 0.0, 0
    total = np.zeros(2)
    for axis in range(len(LINEAR_AXES)):
        for i, rows in enumerate(nine.steps.of_axis(axis)):
            left, noise, free = nine.contradictions[axis][i], nine.expected[axis][i], len(rows) - 3
            squares, dof = squares + free * (left / noise) ** 2, dof + free
            total += len(rows) * np.array([left, noise]) ** 2
    found, noise = np.sqrt(total / len(nine.steps.axis))
    return float(found), float(noise), float(squares), dof


def _contradiction(nine: NineFunctions) -> Iterator[str]:
    found, noise, squares, dof = contradiction(nine)
    if dof and chdtrc(dof, squares) < CHANCE:
        yield (
            f"the four diagonals contradict each other: {1e3 * found:.2f} µm RMS per step instead of {1e3 * noise:.2f} µm. "
            "The axes rotate, a mirror is not square to its beam, or u is stated too small; the nine functions hold it too, and "
            "so do tables made of them: measure plain diagonals (ISO 230-6) before and after a control applies such tables"
        )


def _table(nine: NineFunctions) -> Table:
    rows = []
    for i, name in enumerate(NAMES):
        letter = LINEAR_AXES[i // 3]
        rows += [(name, letter, *map(float, row)) for row in zip(*nine.of(name), strict=True)]
    return Table(("function", "axis", "position_mm", "value_mm", "u_mm"), tuple(rows))
