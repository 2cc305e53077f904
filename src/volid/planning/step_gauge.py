"""Lengths of a step gauge, or of other calibrated test lengths, along lines of the working volume (ISO 10360-2).

The usual seven lines: one along each axis, and the four body diagonals. On every line the gauge is measured from its first face
to several others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from volid.backend.even_points import round_position
from volid.campaign import Campaign, End, ObservationSet
from volid.exceptions import InputError
from volid.model.kinematics import nominal_point
from volid.model.machine import Machine
from volid.model.requests import LARGEST, ask_plan, ask_tools, ask_uncertainty, checked_count, checked_number
from volid.planning.following import follow, within_travel

USED = 0.9  # of the box: probing needs some room at both ends
DIAGONALS = {"PPP": (1, 1, 1), "NPP": (-1, 1, 1), "PNP": (1, -1, 1), "PPN": (1, 1, -1)}


def step_gauge(
    machine: Machine,
    tools: Sequence[Sequence[float]] = ((0.0, 0.0, -150.0),),
    n: int = 5,
    *,
    length: float | None = None,
    u: float = 0.0005,
    calibrated_u: float = 0.0002,
    scale_u: float = 5e-7,
) -> Campaign:
    """Plan of lengths along seven lines: one along each linear axis in the middle of the others, and four body diagonals.

    Args:
        machine: A machine with X, Y and Z.
        tools: Tool vectors to the probe's tip, shape (k, 3) [mm]; every line is measured with each.
        n: Number of lengths on every line: the longest, and its equal parts.
        length: Longest length [mm]; None: 0.9 of what the box of travels allows on each line.
        u: Standard uncertainty of a length as probed [mm].
        calibrated_u: Standard uncertainty of the calibrated lengths that all share [mm].
        scale_u: That of their scale, a ratio: all lengths longer or shorter in proportion.

    Returns:
        A campaign with one `length` set without readings.

    Raises:
        InputError: an axis is missing, a number is none, or a length is longer than its line.

    References:
        ISO 10360-2:2009, 6.3 (five test lengths along seven lines).

    Example:
        >>> from volid.io import read_machine
        >>> plan = step_gauge(read_machine("models/wYXbZt_vertical.toml"))
        >>> len(plan.sets[0]), sorted(set(plan.sets[0].labels["artefact"].tolist()))
        (35, ['gauge'])
    """
    _ask(machine, tools, n, u, calibrated_u)
    checked_number("scale_u", scale_u, least=0.0)
    firsts, seconds, used = [], [], []
    for tool in np.asarray(tools, dtype=float).reshape(-1, 3):
        for start, end in _lines(machine, tool, length):
            parts = start + np.arange(1, n + 1)[:, None] / n * (end - start)
            firsts.append(np.tile(start, (n, 1)))
            seconds.append(parts)
            used.append(np.tile(tool, (n, 1)))
    tool_rows, still = np.concatenate(used), np.zeros((sum(map(len, used)), len(machine.axes)))
    first, second = (follow(machine, still, tool_rows, np.concatenate(p)) for p in (firsts, seconds))
    for q in (first, second):
        within_travel(machine, q, "step gauge")
    labels = {"artefact": np.full(len(tool_rows), "gauge")}
    readings = ObservationSet(
        name="step gauge",
        kind="length",
        positions=round_position(first),
        directions=still,
        tool=tool_rows,
        readings=np.full((len(still), 1), np.nan),
        u=np.full((len(still), 1), u),
        labels=labels,
        options={"relative": False, "calibrated_u": calibrated_u, "scale_u": scale_u, "u": u},
        source="step-gauge plan",
        to=End(round_position(second), still, tool_rows),
    )
    return Campaign(machine, (), (readings,), "Step gauge", source="step-gauge plan")


def _ask(machine: Machine, tools: Sequence[Sequence[float]], n: int, u: float, calibrated_u: float) -> None:
    missing = [a for a in "XYZ" if a not in machine.letters]
    if missing:
        raise InputError(f"machine '{machine.name}' has no axis {missing[0]}; a step gauge needs X, Y and Z")
    ask_tools(machine, tools)
    checked_count("n", n, 1, LARGEST)
    ask_uncertainty("u", u)
    if calibrated_u != 0.0:
        ask_uncertainty("calibrated_u", calibrated_u)
    ask_plan("step gauge", 7 * n * len(tools))


def _lines(machine: Machine, tool: np.ndarray, length: float | None) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Ends of the seven lines, workpiece frame, rotary axes at 0 [mm]. Raises `InputError` for a longer length."""
    low, high = np.array([machine.axis(a).travel for a in "XYZ"]).T
    q = np.zeros((1, len(machine.axes)))
    q[0, [machine.index(a) for a in "XYZ"]] = 0.5 * (low + high)
    middle, half = nominal_point(machine, q, tool[None, :])[0], 0.5 * USED * (high - low)
    for name, way in (*zip("XYZ", np.eye(3), strict=True), *DIAGONALS.items()):
        reach = half * np.asarray(way, dtype=float)
        longest = 2.0 * float(np.linalg.norm(reach))
        if length is not None and not 0.0 < length <= longest / USED:
            raise InputError(
                f"`length={length:g}`: line {name} is {longest / USED:.0f} mm long; expected a length > 0 up to that"
            )
        reach = reach if length is None else reach * (length / longest)
        yield middle - reach, middle + reach
