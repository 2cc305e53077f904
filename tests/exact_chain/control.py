"""A control of the exact machine: it reads tables and grids from files with its own code, and says where the drives go.

Written from the files' lines "# key: value" and from CONVENTIONS 5 alone. Errors of tables stand in the exact chain, whose
deviation they give; grids are interpolated between the nodes around. The linear axes are moved so that the *nominal* functional
point comes to lie where the deviation is undone, found with numerical derivatives of the nominal chain.
"""

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from exact_chain.machine import ExactMachine
from exact_chain.motions import LINEAR, ROTARY, apply
from exact_chain.truth import Truth

COMPONENTS = ("dX", "dY", "dZ", "dA", "dB", "dC")


@dataclass
class Sheet:
    """One file: its record, its columns, and the sign that makes error values of its numbers."""

    record: dict[str, str]
    columns: dict[str, np.ndarray]

    @property
    def sign(self) -> float:
        return {"error": 1.0, "compensation": -1.0}[self.record["values"]]

    def vector(self, key: str) -> np.ndarray:
        return np.array([float(v) for v in self.record[key].split(" mm")[0].split(",")])


def read(path) -> Sheet:
    """A CSV file of numbers below lines "# key: value"; an empty cell is NaN."""
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    record = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# ") and ": " in line)
    rows = list(csv.DictReader(io.StringIO("\n".join(line for line in lines if not line.startswith("#")))))
    return Sheet(record, {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]})


def around(x: np.ndarray, nodes: np.ndarray, turn: bool = False) -> list[tuple[np.ndarray, np.ndarray]]:
    """The two nodes about each place and their shares; beyond the ends the end node, or with `turn` one turn on."""
    if turn:
        x = np.where((x < nodes[0]) | (x > nodes[-1]), nodes[0] + np.mod(x - nodes[0], 360.0), x)
    x = np.clip(x, nodes[0], nodes[-1])
    right = np.clip(np.searchsorted(nodes, x), 1, len(nodes) - 1)
    share = (nodes[right] - x) / (nodes[right] - nodes[right - 1])
    return [(right - 1, share), (right, 1.0 - share)]


@dataclass
class ExactControl:
    """Tables and grids at work. `tool`: the vector that it believes, None for the true one. `increment`, `clamped`: of axes."""

    machine: ExactMachine
    sheets: list[Sheet]
    tool: np.ndarray | None = None
    increment: dict[str, float] = field(default_factory=dict)
    clamped: tuple[str, ...] = ()

    @classmethod
    def of(cls, machine: ExactMachine, paths, **options) -> "ExactControl":
        """The control with the files of some folders."""
        files = [f for p in map(Path, paths) for f in (sorted(p.glob("*.csv")) if p.is_dir() else [p])]
        return cls(machine, [read(f) for f in files], **options)

    def command(self, q, tool, direction=None) -> np.ndarray:
        """Where the drives go for programmed positions q (m, axes)."""
        q = np.atleast_2d(np.asarray(q, float))
        tool = np.broadcast_to(np.asarray(tool if self.tool is None else self.tool, float), (len(q), 3))
        way = np.zeros_like(q) if direction is None else np.asarray(direction, float)
        shift, turn = self._tables(q, tool, way)
        for sheet in self.sheets:
            if "function" not in sheet.record:
                both = self._grid(sheet, q, tool)
                kind = sheet.record["type"]
                shift = shift + (0.0 if kind == "FOR" else both[:, :3])
                turn = turn + (both[:, 3:] if kind in ("FOR", "L-VOL+", "R-VOL+") else 0.0)
        turned = q + self._turns(q, turn)
        only_turns = {s.record["type"] for s in self.sheets} == {"FOR"}
        driven = turned if only_turns else self._moved(q, turned, shift, tool)
        driven = driven + self._themselves(q, way)
        for axis in self.machine.axes:
            i = self.machine.column(axis)
            if axis in self.clamped:
                driven[:, i] = q[:, i]
            if axis in self.increment:
                driven[:, i] = q[:, i] + self.increment[axis] * np.rint((driven[:, i] - q[:, i]) / self.increment[axis])
        return driven

    def _tables(self, q, tool, way) -> tuple[np.ndarray, np.ndarray]:
        """Deviation (m, 3) of the functional point by the tables of the kinematic model; no turn of rotary axes."""
        functions, reversal, constants = {}, {}, {}
        for sheet in self.sheets:
            name = sheet.record.get("function")
            if name and sheet.record["applied"] == "kinematic model":
                up, down = self._both(sheet)
                if name[2] == "S":
                    constants[f"{name[:2]}0S"] = float(up(np.zeros(1))[0])
                    continue
                functions[name] = lambda x, up=up, down=down: (up(x) + down(x)) / 2
                reversal[name] = lambda x, up=up, down=down: up(x) - down(x)
        expected = Truth(functions, constants, reversal)
        return self.machine.deviation(q, tool, expected, way)[:, :3], np.zeros((len(q), 3))

    def _both(self, sheet: Sheet):
        """The error approached in + and in -, as functions of position."""
        name, columns = sheet.record["function"], sheet.columns
        x = columns[name[2]] if name[2] in columns else next(iter(columns.values()))
        total = np.cumsum if sheet.record["rows"] == "incremental" else np.asarray

        def values(column):
            return sheet.sign * total(columns[column])

        if name in columns:
            half = sheet.sign * float(sheet.record.get("reversal value", "0").split()[0]) / 2
            both = values(name) + half, values(name) - half
        elif f"{name}(-)" in columns:
            both = values(f"{name}(+)"), values(f"{name}(-)")
        else:  # 9.2.3: the second column is the reversal alone, added for motion in -
            both = values(f"{name}(+)"), values(f"{name}(+)") + sheet.sign * columns[f"{name}(-)-{name}(+)"]
        turn = not sheet.record["period"].startswith("none")

        def function(v):
            return lambda at: sum(share * v[node] for node, share in around(np.asarray(at, float), x, turn))

        return function(both[0]), function(both[1])

    def _themselves(self, q, way) -> np.ndarray:
        """R-POS: what the tables of a rotary axis itself add to it [degrees]."""
        add = np.zeros_like(q)
        for sheet in self.sheets:
            if sheet.record.get("applied") == "the axis itself":
                axis = sheet.record["function"][2]
                i, (up, down) = self.machine.column(axis), self._both(sheet)
                mean = (up(q[:, i]) + down(q[:, i])) / 2 + way[:, i] * (up(q[:, i]) - down(q[:, i])) / 2
                about = self.machine.frame[axis].T @ self.machine.direction[axis]
                add[:, i] -= np.rad2deg(mean) * about[ROTARY.index(sheet.record["function"][1])]
        return add

    def _grid(self, sheet: Sheet, q, tool) -> np.ndarray:
        """Deviation (m, 6) that a grid gives: interpolated, and moved along the lever arm."""
        axes = [a for a in (*LINEAR, *ROTARY) if a in sheet.columns]
        nodes = [np.unique(sheet.columns[a]) for a in axes]
        table = np.full([*map(len, nodes), 6], np.nan)
        at = tuple(np.searchsorted(n, sheet.columns[a]) for n, a in zip(nodes, axes, strict=True))
        table[at] = sheet.sign * np.stack([sheet.columns[c] for c in COMPONENTS], axis=1)
        table[..., 3:] = np.deg2rad(table[..., 3:])
        full = [f"{a} 360" in sheet.record.get("period", "") for a in axes]
        sides = [around(q[:, self.machine.column(a)], n, t) for a, n, t in zip(axes, nodes, full, strict=True)]
        found = np.zeros((len(q), 6))
        for corner in np.ndindex(*[2] * len(axes)):
            chosen = [s[c] for s, c in zip(sides, corner, strict=True)]
            found += np.prod([share for _, share in chosen], axis=0)[:, None] * table[tuple(i for i, _ in chosen)]
        found[:, :3] += np.cross(found[:, 3:], self._lever(sheet, q, tool))
        return found

    def _lever(self, sheet: Sheet, q, tool) -> np.ndarray:
        """Nominal functional point of the linear axes (table) or tool vector as the head turns it about its lines, from the
        reference."""
        turned = tool
        for axis in reversed(self.machine.axes):
            if axis in ROTARY and not self.machine.primed[axis]:
                turned = apply(self.machine.nominal_factor(axis, q), turned)
        if sheet.record.get("side") != "table":
            key = "reference point" if "side" in sheet.record else "tool vector"
            return turned - sheet.vector(key)
        stands = np.stack([q[:, self.machine.column(a)] if a in self.machine.axes else 0 * q[:, 0] for a in LINEAR], 1)
        return stands + turned - sheet.vector("reference point")

    def _turns(self, q, turn) -> np.ndarray:
        """Turns of the rotary axes (m, axes) [degrees] that undo what of `turn` (m, 3) tilts the tool's own axis."""
        out, rotary = np.zeros_like(q), [self.machine.column(a) for a in self.machine.axes if a in ROTARY]
        if not turn.any():
            return out
        nominal, table, step = self.machine.nominal_pose(q), self.machine.table_rotation(q), 1e-3
        columns = []
        for i in rotary:
            moved = q.copy()
            moved[:, i] += step
            change = self.machine.nominal_pose(moved)[:, :3, :3] @ nominal[:, :3, :3].transpose(0, 2, 1)
            vector = Rotation.from_matrix(change).as_rotvec() / step
            columns.append(np.einsum("mji,mj->mi", table, vector))
        axis = np.einsum("mji,mj->mi", table, nominal[:, :3, 2])
        for m in range(len(q)):
            across = np.eye(3) - np.outer(axis[m], axis[m])
            out[m, rotary] = np.linalg.lstsq(across @ np.stack([c[m] for c in columns], 1), -across @ turn[m], 1e-9)[0]
        return out

    def _moved(self, q, turned, shift, tool) -> np.ndarray:
        """Positions at which the nominal chain, with its rotary axes `turned`, has its point where `shift` is undone."""
        target = apply(self.machine.nominal_pose(q), tool) - np.einsum(
            "mij,mj->mi", self.machine.table_rotation(q), shift
        )
        driven, linear = turned.copy(), [self.machine.column(a) for a in self.machine.axes if a in LINEAR]
        start = apply(self.machine.nominal_pose(turned), tool)
        columns = []
        for i in linear:
            moved = turned.copy()
            moved[:, i] += 1.0
            columns.append(apply(self.machine.nominal_pose(moved), tool) - start)
        jacobian = np.stack(columns, axis=2)
        driven[:, linear] += np.einsum("mij,mj->mi", np.linalg.pinv(jacobian), target - start)
        return driven


class CompensatedMachine:
    """The exact machine with an `ExactControl`: what is asked of it counts from the programmed positions."""

    def __init__(self, control: ExactControl):
        self.control = control

    def __getattr__(self, name: str):
        return getattr(self.control.machine, name)

    def deviation(self, q, tool, truth: Truth, direction=None) -> np.ndarray:
        """Deviation (m, 6) of the pose that the drives reach from the programmed one, machine frame; see `ExactMachine`."""
        machine = self.control.machine
        driven = self.control.command(q, tool, direction)
        actual, nominal = machine.pose(driven, truth, direction), machine.nominal_pose(q)
        turn = Rotation.from_matrix(actual[:, :3, :3] @ nominal[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
        both = np.stack([apply(actual, tool) - apply(nominal, tool), turn], axis=1)
        return np.einsum("mji,mkj->mki", machine.table_rotation(q), both).reshape(-1, 6)
