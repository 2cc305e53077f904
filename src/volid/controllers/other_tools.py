"""How wrong a compensation is for another tool, where a control adds no lever arm of the tool (ISO/TR 16907 11.2 d).

Tables of axes and products of two hold for the tool vector for which they were made. With a tool longer by d, a rotation w of an
axis moves the functional point by w × d more, which nobody takes off. Along a direction of d this is a sum of functions of single
axes; its largest value is the sum of theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from volid.controllers.base import Declaration, Job
from volid.model.iso230 import SPINDLE

MORE = 100.0  # mm of another tool
SEEN = 1e-5  # mm: less is not worth a word


def other_tool_notes(job: Job, declared: Declaration) -> tuple[str, ...]:
    """A sentence on other tools, for a control that multiplies tables and has no kinematic model.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> other_tool_notes(volid.export(solution, "linuxcnc").job, volid.CONTROLS["linuxcnc"].declaration)
    ()
    """
    if declared.model or not declared.products:
        return ()
    wrong = max(_wrong(job, step) for step in MORE * np.eye(3))
    if wrong < SEEN:
        return ()
    tool = ", ".join(f"{v:g}" for v in job.tool)
    return (
        f"all tables hold for the tool vector ({tool}) mm, because the control adds no lever arm of the tool: {MORE:g} mm of "
        f"another tool are wrong by up to {1e3 * wrong:.2f} µm",
    )


def _wrong(job: Job, step: np.ndarray) -> float:
    """Largest error of an axis with a tool vector that differs by `step` [mm]."""
    lines = tuple(t for t in job.compensation.tables if t.axis != SPINDLE)
    made = replace(job, compensation=replace(job.compensation, tables=lines, axis_tables=()))
    here, there = _plain(made), _plain(replace(made, tool=job.tool + step))
    ends: dict[str, np.ndarray] = {}
    for pair in {*here, *there}:
        change = there.get(pair, np.zeros(1)) - here.get(pair, np.zeros(1))
        reach = np.array([change.max(), -change.min()])
        ends[pair[0]] = ends.get(pair[0], np.zeros(2)) + reach
    return max((float(e.max()) for e in ends.values()), default=0.0)


def _plain(job: Job) -> Mapping[tuple[str, str], np.ndarray]:
    """Values of both directions by output and argument, of tables without a lever arm, which alone depend on the tool."""
    tables = job.axis_tables(products=True)
    return {(t.output, t.argument): np.concatenate([t.forward, t.reverse]) for t in tables if t.factor is None}
