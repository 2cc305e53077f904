"""Alternatives in time: a station that drifts, growth with time or temperature, a beam that was broken inside a segment."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from volid.fitting.diagnosis.alternatives.base import OPEN, Alternative
from volid.fitting.diagnosis.alternatives.shapes import span
from volid.fitting.diagnosis.around import Around
from volid.fitting.diagnosis.sensitivities import Sensitivities
from volid.model.error_model import ROWS
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Machine
from volid.observations import KINDS

DRIFT, GROWTH, WARMTH, BREAK = "drift of a station", "growth with time", "growth with temperature", "beam break"
ENDS = 3  # readings of a segment before and after a break, at least


def drifts(around: Around) -> Iterator[Alternative]:
    """Every station (sphere, …) moves, and its readings grow, with time and its square."""
    for name in sorted(set(around.standing.tolist()) - {""}):
        own = (around.standing == name) & around.active
        if len(np.unique(around.when[own])) < 4:
            continue
        t = np.zeros(len(own))
        t[own] = span(around.when[own])
        shapes = [t, np.where(own, t**2 - np.mean(t[own] ** 2), 0.0)]
        moved = np.concatenate([around.target * s for s in shapes])
        grown = np.stack([around.weight * s for s in shapes])
        clock = "time" if around.has_time else "the order of its rows"
        kind, label = name.split(" ", 1)
        cure = (
            f"campaign: give the readings of {label} other names in column '{kind}' from one part of its time to the next "
            f"({label}a, {label}b, …, stated like {label}), so that each part has a place of its own; where only the readings "
            f'grow with a recorded time, [[set.effect]]: name = "drift", type = "drift", u = 0.005, per = "{kind}"; or fix '
            f"{label} better, and measure from there again"
        )
        yield Alternative(DRIFT, f"{name} drifts with {clock}", cure, np.concatenate([moved, grown]).T)


def growths(around: Around, machine: Machine) -> Iterator[Alternative]:
    """The machine and its spindle grow with time, and with the recorded temperature."""
    outcome = around.outcome.seen
    if len(np.unique(around.when[around.active])) > 3:
        t = span(around.when)
        clock = "time" if around.has_time else "the order of the rows"
        cure = "let the machine warm up until it no longer grows, and measure again, in less time or from all stations in turns"
        columns, change = _grown(around.seen, machine, t), _grown(outcome, machine, np.ones(len(outcome.positions)))
        yield Alternative(GROWTH, f"the machine grows with {clock}", cure, columns, change)
    if around.temperature is not None:
        t = span(around.temperature)
        cure = "measure again at one temperature, or one campaign for each temperature"
        columns, change = _grown(around.seen, machine, t), _grown(outcome, machine, np.ones(len(outcome.positions)))
        yield Alternative(WARMTH, "the machine grows with the recorded temperature", cure, columns, change)


def _grown(seen: Sensitivities, machine: Machine, t: np.ndarray) -> np.ndarray:
    """A shift of the first axis in three directions, the scales of the linear axes, location of the rotary ones, (n, k)."""
    t = seen.of_each(t)
    columns = [seen.errors[c] * t for c in range(3)]
    for i, axis in enumerate(machine.axes):
        rows = seen.errors[ROWS * i : ROWS * (i + 1)]
        if axis.is_linear:
            columns.append(rows[LINEAR_AXES.index(axis.letter)] * t * span(seen.positions[:, i]))
        else:
            columns += [row * t for row in rows]
    return seen.summed(np.stack(columns, axis=1))


def breaks(around: Around) -> Iterator[Alternative]:
    """In every uninterrupted run of readings, the row from which on they are longer by a constant.

    The row is the one of the largest gain, and `tried` says of how many.
    """
    runs = _runs(around)
    tried = float(sum(len(numbers) for _, numbers in runs))
    best = [(gain, i, name, numbers) for name, numbers in runs for gain, i in [_step(around, numbers)]]
    for gain, i, name, numbers in sorted(best, key=lambda b: -b[0])[:3]:
        if gain <= 0.0:
            continue
        column = np.zeros(len(around.v))
        column[numbers[i:]] = around.weight[numbers[i:]]
        runs_on = tuple(numbers[i:].tolist())
        where, when = around.where(int(numbers[i])), around.when[numbers[i]]
        at = f" (time {when:g} s)" if around.has_time else ""
        cure = f"campaign: another name in column 'segment' from {where} on; a robust fit does so where the step exceeds 4 u"
        what = f"beam of {name} was broken before {where}{at}"
        yield Alternative(BREAK, what, cure, column[:, None], tried=tried, readings=runs_on)


def _runs(around: Around) -> list[tuple[str, np.ndarray]]:
    """Name and reading numbers, in order of time, of every run with a constant of its own."""
    found = []
    for i, s in enumerate(around.campaign.sets):
        kind = KINDS[s.kind]
        if not kind.runs_by(s):
            continue
        text = np.array([" ".join(f"{label} {s.labels[label][r]}" for label in kind.runs_by(s)) for r in range(len(s))])
        first = np.flatnonzero(around.set_number == i)
        for name in dict.fromkeys(text.tolist()):
            own = first[(text == name) & around.active[first]]
            if len(own) >= 4 * ENDS:
                found.append((name, own[np.argsort(around.when[own], kind="stable")]))
    return found


def _step(around: Around, numbers: np.ndarray) -> tuple[float, int]:
    """Largest fall of chi-square by a step inside one run, and the place in the run from which on it acts."""
    weight = around.weight[numbers]
    pull = np.cumsum((weight * around.v[numbers])[::-1])[::-1]
    reach = np.cumsum((weight[:, None] * around.rows[numbers])[::-1], axis=0)[::-1]
    square = np.cumsum((weight**2)[::-1])[::-1]
    left = square - np.sum(reach**2, axis=1)
    inner = slice(ENDS, len(numbers) - ENDS + 1)
    seen = left > OPEN * square
    gain = np.where(seen, pull**2 / np.where(seen, left, 1.0), 0.0)[inner]
    return (float(gain.max()), ENDS + int(np.argmax(gain))) if gain.size else (0.0, 0)
