"""Step diagonals of exact machines in the hands of volid: read from their table, separated, written as tables, on a control."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from exact_chain import Truth, gauge_free, machine_grid
from exact_chain.step_cases import TILT, TOOL, Case, read, table

from support.machines import volid_machine
from volid.compensation.control import Control
from volid.io.compensations import load_control
from volid.io.evaluations.step_diagonal_tables import save_step_tables
from volid.io.evaluations.step_diagonals import read_step_diagonals
from volid.standards.step_diagonals.separation import NineFunctions, separate
from volid.standards.step_diagonals.steps import steps_of


def nine_of(folder: Path, case: Case, found: dict[str, np.ndarray]) -> NineFunctions:
    """The nine functions of readings, by way of their table."""
    path = Path(folder) / "steps.csv"
    path.write_text(table(case, found), encoding="utf-8")
    campaign = read_step_diagonals(path, volid_machine(case.machine))
    return separate(steps_of(campaign.sets[0], campaign))


def along_middle(case: Case, truth: Truth) -> list[np.ndarray]:
    """True deviations of the functional point along lines through the middle of the box, 0 at the low end, (n + 1, 3) [mm]."""
    machine, found = case.machine, []
    for letter in "XYZ":
        places = {a: np.full(case.n + 1, np.mean(machine.travel[a])) for a in "XYZ"} | {letter: case.nodes(letter)}
        e = machine.deviation(machine.in_axis_order(places), TOOL, truth)[:, :3]
        found.append(e - e[0])
    return found


def compensated(folder: Path, case: Case, truth: Truth, rng=None, tilt: float = TILT) -> Control:
    """The control with the tables that step diagonals of the machine give, written to files and read back."""
    nine = nine_of(folder, case, read(case, truth, rng, tilt=tilt))
    save_step_tables(nine, Path(folder) / "tables", overwrite=True)
    return load_control(volid_machine(case.machine), [Path(folder) / "tables"])


def largest_in_volume(case: Case, truth: Truth, control: Control | None = None) -> float:
    """Longest deviation of the functional point in the volume, its best rigid motion taken out [mm]."""
    machine = case.machine
    q = machine_grid(machine, 7)
    moved = q if control is None else control.command(q, TOOL, np.zeros_like(q))
    away = machine.functional_point(moved, TOOL, truth) - machine.functional_point(q, TOOL)
    left, _ = gauge_free(away, q[:, [machine.column(a) for a in "XYZ"]], TOOL, tool_rotation=False)
    return float(np.linalg.norm(left, axis=1).max())
