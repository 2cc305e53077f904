"""Compensated machines under virtual instruments: tables written by hand, small sets, the same truth for both chains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from exact_chain import ExactMachine
from exact_chain import Truth as ExactTruth

from volid.campaign import Campaign, ObservationSet, Station
from volid.model.machine import Machine
from volid.virtual.simulate import simulate
from volid.virtual.truth import Truth


def write_table(
    folder: Path, function: str, x, forward, reverse=None, *, sign: float = -1.0, style: str = "columns"
) -> Path:
    """A table of ERROR values [mm, rad] over `x` as a compensation file; `sign` +1 writes it with the wrong sign.

    `style` of the reversal: "columns", "difference" (added for motion in -) or "value" (one number in the record).
    """
    up = sign * np.asarray(forward, float)
    down = up if reverse is None else sign * np.asarray(reverse, float)
    axis, keys = function[2], ["format: volid-table/1", f"type: {_type(function)}", f"function: {function}"]
    keys += ["values: compensation", "rows: absolute", "applied: kinematic model", "zero: not stated"]
    keys += ["period: none", "datum: not stated"]
    if reverse is None:
        columns = {axis: x, function: up}
    elif style == "columns":
        columns = {axis: x, f"{function}(+)": up, f"{function}(-)": down}
    elif style == "difference":
        columns = {axis: x, f"{function}(+)": up, f"{function}(-)-{function}(+)": down - up}
    else:
        keys.append(f"reversal value: {float(np.mean(up - down))!r} mm")
        columns = {axis: x, function: (up + down) / 2}
    rows = [",".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{function}.csv"
    path.write_text("\n".join([*(f"# {k}" for k in keys), ",".join(columns), *rows, ""]), encoding="utf-8")
    return path


def _type(function: str) -> str:
    return "L-ANG" if function[1] in "ABC" else "L-POS" if function[1] == function[2] else "L-STR"


def both_truths(machine: Machine, truth: ExactTruth) -> Truth:
    """The package's truth with the same functions."""
    return Truth(machine, truth.functions, truth.cross, truth.reversal, truth.constants)


def a_set(kind: str, q, tool, way=None, *, labels=None, options=None, u: float = 1e-4, name: str = "set", time=None):
    """A planned set of one kind with m rows."""
    q = np.atleast_2d(np.asarray(q, float))
    k = {"displacement": 3}.get(kind, 1)
    labels = {n: np.broadcast_to(np.asarray(v, dtype=str), (len(q),)).copy() for n, v in (labels or {}).items()}
    return ObservationSet(
        name, kind, q, np.zeros_like(q) if way is None else np.asarray(way, float),
        np.broadcast_to(np.asarray(tool, float), (len(q), 3)).copy(), np.full((len(q), k), np.nan),
        np.full((len(q), k), u), labels, time=time, options=options or {},
    )  # fmt: skip


def bar(q, tool, centre, way=None, **more) -> tuple[Campaign, ObservationSet]:
    """Distances from a known centre on the workpiece, and the station that it is."""
    labels = {"station": "centre", "segment": "1"}
    options = {"relative": False, "calibrated_u": 0.0}
    return a_set("distance", q, tool, way, labels=labels, options=options, name="bar", **more), Station(
        "centre", position=tuple(float(c) for c in centre), known=True, frame="machine"
    )


def components(q, tool, component: str, way=None, **more) -> ObservationSet:
    """One component of the deviation along one line."""
    labels = {"component": component, "line": "1", "run": "1"}
    return a_set(
        "component", q, tool, way, labels=labels, options={"slope": False}, name=f"component {component}", **more
    )


def read(machine: Machine, sets, truth: Truth, control=None, stations=()) -> list[np.ndarray]:
    """Readings without noise of every set, (m, k)."""
    campaign, _ = simulate(Campaign(machine, tuple(stations), tuple(sets)), truth, seed=5, noise=False, control=control)
    return [s.readings for s in campaign.sets]


def at(exact: ExactMachine, **positions) -> np.ndarray:
    """Positions (m, axes) from columns by axis letter."""
    return exact.in_axis_order(positions)
