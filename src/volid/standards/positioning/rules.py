"""Rules of ISO 230-2 for the test itself, and what it breaks of them, in words. The quantities are evaluated all the same.

Linear axes up to 2000 mm: at least five targets per metre and at least five in all; five approaches of each target in each
direction; targets p_i = (i - 1) p + r with another r at every target, so that periodic errors are sampled. What is recalled
here and not read in a source at hand: above 2000 mm a spacing of about 250 mm; rotary axes: at least 3 targets up to 90°, 5
up to 180°, 8 above.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from volid.standards.positioning.runs import WAY_NAMES, PositioningRuns, statistics_of

APPROACHES = 5  # of each target in each direction
PER_METRE, LEAST, LONG = 5, 5, 2000.0  # targets, targets, mm
SPACING, GENEROUS = 250.0, 1.1  # mm, above `LONG`; "about"
ROTARY = ((90.0, 3), (180.0, 5), (math.inf, 8))  # up to this range [°] so many targets
EQUAL = 0.01  # steps that differ by less than this share of the step are equal
COVERED = 0.9  # share of the travel
STRAY = (
    6.0  # standard deviations, of the others at the target and of what is typical of the test, that make a stray one
)


def rules(runs: PositioningRuns) -> tuple[str, ...]:
    """What the test breaks of the standard's rules."""
    return (*_targets(runs), *_equal_steps(runs), *_approaches(runs), *_directions(runs), *_travel(runs), *_stray(runs))


def attention(runs: PositioningRuns) -> tuple[str, ...]:
    """Why the numbers need a second look: none of them can mean what the symbol says."""
    return (*_repeated(runs), *_whole_turn(runs))


def _whole_turn(runs: PositioningRuns) -> Iterator[str]:
    """A rotary target 0 that was approached twice as often as all others: two targets, 0° and 360°, displayed alike."""
    counts = np.isfinite(runs.deviations).sum(axis=(1, 2))
    at = np.flatnonzero(np.abs(runs.targets) < 1e-6)
    if runs.is_rotary and len(at) and len(counts) > 1:
        others = np.delete(counts, at[0])
        if counts[at[0]] == 2 * others.max() == 2 * others.min():
            yield (
                f"{runs.axis}: target 0 was approached twice as often as every other one, as where targets 0° and 360° are both "
                "displayed as 0; E lacks the last target then, and R holds the error of a whole turn; write 360 for it"
            )


def _repeated(runs: PositioningRuns) -> Iterator[str]:
    """Runs that are copies of each other."""
    spread = np.fmax.reduce(runs.deviations, axis=2) - np.fmin.reduce(runs.deviations, axis=2)
    if runs.deviations.shape[2] > 1 and not np.nan_to_num(spread).any():
        yield f"{runs.axis}: all runs are equal to the last digit, so that R is 0; expected readings of every run"


def wanted_targets(runs: PositioningRuns) -> tuple[int, str]:
    """How many targets the standard asks for at least, and by which rule, in words."""
    length = runs.length
    if runs.is_rotary:
        most, count = next(rule for rule in ROTARY if length <= rule[0] + 1e-9)
        words = f"a range up to {most:g}°" if math.isfinite(most) else "a range above 180°"
        return count, f"{count} targets over {words} (the standard's table, recalled)"
    if length > LONG:
        count = math.ceil(length / (SPACING * GENEROUS)) + 1
        return count, f"a spacing of about {SPACING:g} mm above {LONG:g} mm (recalled)"
    return max(
        LEAST, math.ceil(PER_METRE * length / 1000.0 - 1e-9)
    ), f"{PER_METRE} targets per metre and {LEAST} in all"


def _targets(runs: PositioningRuns) -> Iterator[str]:
    count, rule = wanted_targets(runs)
    if len(runs.targets) < count:
        unit = "°" if runs.is_rotary else " mm"
        yield f"{len(runs.targets)} targets over {runs.length:g}{unit}; ISO 230-2 asks for at least {rule}: {count} here"


def _equal_steps(runs: PositioningRuns) -> Iterator[str]:
    steps = np.diff(runs.targets)
    if len(steps) > 1 and np.ptp(steps) < EQUAL * steps.mean():
        unit = "°" if runs.is_rotary else " mm"
        yield (
            f"all targets are {steps.mean():.6g}{unit} apart; ISO 230-2 asks for (i - 1) p + r with another r at every target, "
            "because an error whose period fits the step looks the same at all of them and is not seen"
        )


def _approaches(runs: PositioningRuns) -> Iterator[str]:
    if runs.are_means:
        yield "only means are known, not the approaches they come from: A and R are not determined"
        return
    counts = np.isfinite(runs.deviations).sum(axis=2)[:, list(runs.directions)]
    fewest, most = int(counts.min()), int(counts.max())
    if fewest < APPROACHES:
        target = runs.targets[int(np.argmin(counts.min(axis=1)))]
        where = "every target" if fewest == most else f"target {target:g}"
        lost = {
            0: "; A, R and E hold for what was approached",
            1: "; without a second one the scatter, A and R are not determined",
        }.get(fewest, "")
        counted = {0: "no approach", 1: "one approach"}.get(fewest, f"{fewest} approaches")
        yield f"{where} has {counted} in a direction; ISO 230-2 asks for {APPROACHES}{lost}"
    elif fewest != most:
        yield f"targets have {fewest} to {most} approaches in a direction, and count alike"


def _directions(runs: PositioningRuns) -> Iterator[str]:
    if len(runs.directions) == 1:
        way = runs.directions[0]
        yield (
            f"approached in {'+-'[way]} only: quantities of both directions are not determined, those with "
            f"'{WAY_NAMES[way]}' hold"
        )


def _travel(runs: PositioningRuns) -> Iterator[str]:
    if runs.travel is None:
        return
    share = runs.length / (runs.travel[1] - runs.travel[0])
    if share < COVERED:
        yield f"the targets cover {100.0 * share:.0f} % of the travel of {runs.axis}; the quantities hold for that part"


def _stray(runs: PositioningRuns) -> Iterator[str]:
    """The approach that lies farthest outside the others of its target and direction, where their scatter does not explain it.

    `STRAY` standard deviations both of these others, which are few, and of what is typical of the test.
    """
    n = np.isfinite(runs.deviations).sum(axis=2)[..., None]
    if runs.are_means or int(n.max()) < 4:
        return
    away, s = _against_others(runs.deviations)
    typical = float(np.nanmedian(statistics_of(runs.deviations).s))
    unit = np.maximum(s, typical) * np.sqrt(1.0 + 1.0 / np.maximum(n - 1, 1))
    size = np.where((n > 3) & (unit > 0.0) & np.isfinite(away), np.abs(away) / np.where(unit > 0.0, unit, 1.0), 0.0)
    worst = np.unravel_index(int(np.argmax(size)), size.shape)
    if size[worst] <= STRAY:
        return
    i, way, run = (int(k) for k in worst)
    shown = f"{3600.0 * away[worst]:+.1f} arc sec" if runs.is_rotary else f"{1e3 * away[worst]:+.1f} µm"
    others = int((size > STRAY).sum()) - 1
    more = f", and so do {others} more of the test" if others else ""
    yield (
        f"target {runs.targets[i]:g} approached in {'+-'[way]}: approach {run + 1} lies {shown} from the mean of the others, "
        f"more than their scatter explains{more}; it counts all the same, as ISO 230-2 has it"
    )


def _against_others(deviations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every approach minus the mean of the others of its target and direction, and their standard deviation, both (t, 2, n)."""
    n = deviations.shape[2]
    others = np.stack([np.delete(deviations, j, axis=2) for j in range(n)], axis=2)  # (t, 2, n, n - 1)
    found = statistics_of(others)
    return deviations - found.mean, found.s
