"""Compensated virtual machines for tests: what is left of the exact chain's deviation when a control alters the command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from exact_chain import ExactMachine, Truth
from scipy.spatial.transform import Rotation

from support.machines import exact_machine, resolved
from support.made_up import made_up
from volid.compensation.base import base_of
from volid.compensation.package import compensate
from volid.compensation.tables.sampling import Sampling
from volid.io.compensations import load_control, save_compensation
from volid.model.iso230 import parse

MACHINES = {
    "three-axis": "w X' Y' b Z t",
    "tilting table": "w C' A' Y' X' b Z t",
    "fork head": "w Y' b X Z C A t",
}
TOOL = (0.0, 0.0, -150.0)
LINEAR_NODES, ROTARY_NODES = 5, 9


def only(solution, keep):
    """The solution with the functions that `keep` accepts; all others zero."""
    mask = np.zeros(solution.model.n_parameters)
    for f in solution.model.functions:
        if keep(parse(f.name)):
            mask[f.parameters] = 1.0
    return replace(solution, parameters=np.asarray(solution.parameters) * mask)


def machine_and_solution(layout, *, functions: str = "", segments: int = 4, **made):
    """Exact machine of a layout, and a solution for it."""
    exact = exact_machine(MACHINES[layout])
    return exact, made_up(resolved(exact, functions, segments), **made)


def node_positions(exact: ExactMachine, m: int, seed: int = 1) -> np.ndarray:
    """Random choices among the nodes of all tables and grids, where nothing is interpolated."""
    rng = np.random.default_rng(seed)
    counts = [LINEAR_NODES if a in "XYZ" else ROTARY_NODES for a in exact.axes]
    return np.stack(
        [rng.choice(np.linspace(*exact.travel[a], n), m) for a, n in zip(exact.axes, counts, strict=True)], 1
    )


def control_of(solution, names, folder, *, at=None, elevation=0.0, functions=(), rule=None, options=None, tool=TOOL):
    """Compensation computed, written to files, read back: the control that holds it."""
    base = base_of(solution, tool, at, elevation, functions)
    linear = [n for n in names if n.startswith("L-") or n == "FOR"]
    made = compensate(
        solution,
        names,
        base,
        tables=Sampling(max_points=LINEAR_NODES if linear else ROTARY_NODES),
        points=None,
        grids=None,
        rule=rule,
        uncertainty=False,
    ) if not names else _at_nodes(solution, names, base, rule)  # fmt: skip
    save_compensation(made, solution, folder)
    return load_control(solution.machine, [folder], **(options or {}))


def _at_nodes(solution, names, base, rule):
    """Linear grids and tables with `LINEAR_NODES`, rotary ones with `ROTARY_NODES`."""
    parts = [
        compensate(solution, names, base, tables=Sampling(max_points=n), points=n, rule=rule, uncertainty=False)
        for n in (LINEAR_NODES, ROTARY_NODES)
    ]
    tables = [t for t in parts[0].tables if t.axis not in "ABC"] + [t for t in parts[1].tables if t.axis in "ABC"]
    grids = [g for g in parts[0].grids if g.side == "linear"] + [g for g in parts[1].grids if g.side != "linear"]
    return replace(parts[0], tables=tuple(tables), grids=tuple(grids))


def remaining(exact: ExactMachine, truth: Truth, q, altered, tool, direction=None) -> np.ndarray:
    """Deviation from the *commanded* nominal point and orientation, machine frame, (m, 6), by exact matrices."""
    actual, nominal = exact.pose(altered, truth, direction), exact.nominal_pose(q)
    tool = np.broadcast_to(np.asarray(tool, float), (len(q), 3))
    point = np.einsum("mij,mj->mi", actual[:, :3, :3], tool) + actual[:, :3, 3]
    point = point - np.einsum("mij,mj->mi", nominal[:, :3, :3], tool) - nominal[:, :3, 3]
    turn = Rotation.from_matrix(actual[:, :3, :3] @ nominal[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    both = np.stack([point, turn], axis=1)
    return np.einsum("mji,mkj->mki", exact.table_rotation(q), both).reshape(-1, 6)
