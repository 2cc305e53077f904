"""Alternatives in the error functions: a cross effect, a function or a reversal left out, few segments, a pitch."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from volid.fitting.diagnosis.alternatives.base import Alternative
from volid.fitting.diagnosis.alternatives.shapes import low_order, products
from volid.fitting.diagnosis.around import Around
from volid.fitting.diagnosis.sensitivities import Sensitivities
from volid.model.error_functions import settings_for
from volid.model.error_model import MEAN, ROWS, ErrorModel
from volid.model.error_model import REVERSAL as REVERSED
from volid.model.iso230 import DIRECTIONS
from volid.model.machine import Machine

CROSS, REVERSAL, PITCH = "cross effect", "reversal left out", "pitch waves"
LEFT_OUT, FINER = "function left out", "too few segments"
_MODEL, _AUTO = "machine file, [model.functions]:", '{ segments = "auto" }'
MOST_ORDERS = 24  # of polynomials that stand for finer segments
OWN, OTHER = 3, 2  # orders along the own axis and over the other one
FINEST = 1.0  # mm: shortest period looked for
FEWEST_WAVES = 12  # in the measured range: longer ones are a matter of the smooth functions
OVERSAMPLED = 2.0  # trial periods per resolved one
MOST_PERIODS = 3000
OUTSTANDING = 8.0  # medians of the periodogram; the largest of a thousand white ones is about 5
SCANNED = 6000  # readings that the first look at all periods takes


def cross_effects(around: Around, model: ErrorModel) -> Iterator[Alternative]:
    """Every error function of an axis over every other axis that moved."""
    machine = model.machine
    for axis in machine.axes:
        for other in machine.axes:
            if other.letter == axis.letter or not _moves(around, machine, axis.letter, other.letter):
                continue
            for component in range(ROWS):
                name = f"E{DIRECTIONS[component]}{axis.letter}"
                if settings_for(machine, name).over is not None:
                    continue
                yield Alternative(
                    CROSS,
                    f"{name} changes with {other.letter}",
                    f'{_MODEL} {name} = {{ over = ["{axis.letter}", "{other.letter}"] }}',
                    _crossed(around.seen, machine, axis.letter, other.letter, component),
                    _crossed(around.outcome.seen, machine, axis.letter, other.letter, component),
                )


def _moves(around: Around, machine: Machine, *letters: str) -> bool:
    """Whether axes stood at three positions or more."""
    columns = (around.seen.positions[:, machine.index(letter)] for letter in letters)
    return all(len(np.unique(np.round(c, 3))) > 2 for c in columns)


def _crossed(seen: Sensitivities, machine: Machine, axis: str, other: str, component: int) -> np.ndarray:
    """(n, k)."""
    i, j = machine.index(axis), machine.index(other)
    own = low_order(machine.axes[i], seen.positions[:, i], OWN)
    both = products(own, low_order(machine.axes[j], seen.positions[:, j], OTHER))
    return seen.summed((seen.errors[ROWS * i + component] * both).T)


def left_out(around: Around, model: ErrorModel) -> Iterator[Alternative]:
    """Error motions that the machine file takes out of the model, of every axis that moved: one by one, and all of an axis."""
    machine = model.machine
    for i, axis in enumerate(machine.axes):
        missing = [c for c in range(ROWS) if (f"E{DIRECTIONS[c]}{axis.letter}", MEAN) not in model.by_name]
        if not missing or not _moves(around, machine, axis.letter):
            continue
        each = [(_along(around.seen, machine, i, c), _along(around.outcome.seen, machine, i, c)) for c in missing]
        names = [f"E{DIRECTIONS[c]}{axis.letter}" for c in missing]
        for name, (columns, change) in zip(names, each, strict=True):
            cure = f"{_MODEL} {name} = true"
            yield Alternative(LEFT_OUT, f"{name} is not in the model, but the machine has it", cure, columns, change)
        cure = f'{_MODEL} "E?{axis.letter}" = true'
        what = f"error motions of {axis.letter} are not in the model, but the machine has them"
        yield Alternative(LEFT_OUT, what, cure, np.hstack([c for c, _ in each]), np.hstack([o for _, o in each]))


def _along(seen: Sensitivities, machine: Machine, i: int, component: int) -> np.ndarray:
    """A function of low order of its own axis, (n, k)."""
    return seen.summed((seen.errors[ROWS * i + component] * low_order(machine.axes[i], seen.positions[:, i], OWN)).T)


def finer(around: Around, model: ErrorModel) -> Iterator[Alternative]:
    """Functions whose stated segments are too few for their shape: one by one, of an axis, and all of them."""
    machine, every = model.machine, []
    for i, axis in enumerate(machine.axes):
        own = []
        for component in range(ROWS):
            name = f"E{DIRECTIONS[component]}{axis.letter}"
            function = model.by_name.get((name, MEAN))
            if function is None or not function.splines or settings_for(machine, name).segments == "auto":
                continue
            order = min(2 * function.splines[0].segments + 6, MOST_ORDERS)
            row = ROWS * i + component
            columns, change = (
                s.summed((s.errors[row] * low_order(axis, s.positions[:, i], order)).T)
                for s in (around.seen, around.outcome.seen)
            )
            own.append([columns, change])
            yield Alternative(FINER, f"{name} has too few segments", f"{_MODEL} {name} = {_AUTO}", columns, change)
        if own:
            what, cure = (
                f"the functions of {axis.letter} have too few segments",
                f'{_MODEL} "E?{axis.letter}" = {_AUTO}',
            )
            yield Alternative(FINER, what, cure, *_side_by_side(own))
        every += own
    if every:
        what, cure = "the functions have too few segments", 'machine file, [model]: segments = "auto"'
        yield Alternative(FINER, what, cure, *_side_by_side(every))


def _side_by_side(pairs: list[list[np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    return np.hstack([p[0] for p in pairs]), np.hstack([p[1] for p in pairs])


def reversals(around: Around, model: ErrorModel) -> Iterator[Alternative]:
    """Every error function of an axis that was approached from both sides, with a reversal value, and all of its six."""
    machine = model.machine
    for i, axis in enumerate(machine.axes):
        ways = around.seen.directions[around.seen.of_each(around.active), i]
        if not (np.any(ways > 0.0) and np.any(ways < 0.0)):
            continue
        names = [f"E{d}{axis.letter}" for d in DIRECTIONS]
        missing = [c for c in range(ROWS) if (names[c], REVERSED) not in model.by_name]
        each = [_reversed(around.seen, machine, i, c) for c in missing]
        outcome = [_reversed(around.outcome.seen, machine, i, c) for c in missing]
        for component, columns, change in zip(missing, each, outcome, strict=True):
            name = names[component]
            cure = f"{_MODEL} {name} = {{ reversal = true }}"
            yield Alternative(REVERSAL, f"{name} has a reversal", cure, columns, change)
        if len(missing) < 2:
            continue
        cure = f'{_MODEL} "E?{axis.letter}" = {{ reversal = true }}'
        what = f"several error functions of {axis.letter} have a reversal"
        yield Alternative(REVERSAL, what, cure, np.hstack(each), np.hstack(outcome))


def _reversed(seen: Sensitivities, machine: Machine, i: int, component: int) -> np.ndarray:
    """Half the reversal value, constant and linear over the axis, (n, 2): E(q, ±) = E(q) ± B(q)/2."""
    half = 0.5 * seen.errors[ROWS * i + component] * seen.directions[:, i]
    return seen.summed(np.stack([half, half * low_order(machine.axes[i], seen.positions[:, i], 1)[0]], axis=1))


def pitches(around: Around, machine: Machine) -> Iterator[Alternative]:
    """Waves of the best period in the three translations of every linear axis; `tried`: periods looked at."""
    for i, axis in enumerate(machine.axes):
        positions = around.seen.positions[:, i]
        measured = float(np.ptp(positions))
        if (
            not axis.is_linear
            or axis.pitch
            or measured < FEWEST_WAVES * FINEST
            or not _moves(around, machine, axis.letter)
        ):
            continue
        frequencies = _frequencies(measured)
        period = _best_period(around, i, frequencies)
        if period is None:
            continue
        yield Alternative(
            PITCH,
            f"waves with a period of {period:.4g} mm along {axis.letter}",
            f"machine file, [axis.{axis.letter}]: pitch = {period:.4g}",
            _waves(around.seen, i, period),
            _waves(around.outcome.seen, i, period),
            float(len(frequencies)),
        )


def _frequencies(measured: float) -> np.ndarray:
    """Of the waves that are looked for [1/mm]."""
    low, high = FEWEST_WAVES / measured, 1.0 / FINEST
    count = int(OVERSAMPLED * measured * (high - low)) + 2
    return np.linspace(low, high, count) if count <= MOST_PERIODS else np.geomspace(low, high, MOST_PERIODS)


def _waves(seen: Sensitivities, i: int, period: float) -> np.ndarray:
    """Cosine and sine in the three translations, (n, 6)."""
    phase = 2.0 * np.pi * seen.positions[:, i] / period
    return seen.summed(np.concatenate([seen.errors[ROWS * i : ROWS * i + 3] * f(phase) for f in (np.cos, np.sin)]).T)


def _best_period(around: Around, i: int, frequencies: np.ndarray) -> float | None:
    """Where the sum of the three translations' periodograms is largest, between its neighbours too [mm].

    None where nothing stands out: other misfits fill the whole periodogram, and any period explains a little of them.
    """
    every = max(len(around.v) // SCANNED, 1)
    q = around.seen.positions[::every, i]
    rows = around.seen.errors[ROWS * i : ROWS * i + 3, ::every]
    strength = np.maximum(np.sum(rows**2, axis=1), 1e-300)
    v = around.seen.of_each(around.v)[::every]

    def power(f: np.ndarray) -> np.ndarray:
        turned = np.exp(2j * np.pi * np.outer(f, q))
        return np.asarray(np.sum(np.abs(turned @ (rows * v).T) ** 2 / strength, axis=1))

    parts = [power(part) for part in np.array_split(frequencies, max(len(frequencies) // 200, 1))]
    whole = np.concatenate(parts)
    best = int(np.argmax(whole))
    if whole[best] < OUTSTANDING * np.median(whole):
        return None
    near = np.linspace(frequencies[max(best - 1, 0)], frequencies[min(best + 1, len(frequencies) - 1)], 41)
    return float(1.0 / near[int(np.argmax(power(near)))])
