"""Files with parameters of ISO 230, read and set to work by a chain of exact matrices, without volid.

What the files mean is taken from the vendor's pages, and where these are silent from what volid states as inferred (see the
commissioning sheet of isg-volcomp): linear axes in the tool's chain with errors in the carriage; rotary axes turn about their
ideal line, and their errors act after it; those of a table are the table's own, in the machine.
"""

import re
from dataclasses import dataclass

import numpy as np
from exact_chain.motions import COMPONENTS, LINEAR, apply, rigid, unit


def blocks(text: str) -> list[tuple[list[str], np.ndarray]]:
    """Columns and rows of each block of a file of the format ISG_CSV."""
    found = []
    for part in text.split("\n#\n"):
        lines = [line.split("//")[0].split() for line in part.splitlines()]
        lines = [words for words in lines if words]
        found.append((lines[0], np.array([[float(w) for w in words] for words in lines[1:]])))
    return found


def sections(text: str) -> list[tuple[list[str], np.ndarray]]:
    """The same of an exchange text of ETALON."""
    found = []
    plain = re.sub(r"//[^\n]*", "", text)
    for name, value, points in re.findall(r"\[(\w+)\]\s*(?:VALUE\s*=\s*(\S+)|Gridpoints\s*=\s*\{([^}]*)\})", plain):
        numbers = np.array([float(w) for w in (value or points).split()])
        found.append(([name], numbers.reshape(1, 1)) if value else ([name[2], name], numbers.reshape(-1, 2)))
    return found


@dataclass
class FileChain:
    """A control with the parameters of a file: chain from workpiece to tool, of which the first `tables` carry the workpiece."""

    found: list[tuple[list[str], np.ndarray]]
    chain: str
    tables: int

    def constant(self, name: str, default: float = 0.0) -> float:
        return next((float(rows[0, c.index(name)]) for c, rows in self.found if name in c), default)

    def vector(self, first: str, last: str, default) -> np.ndarray:
        return np.array([self.constant(f"{first}{c}{last}", d) for c, d in zip(LINEAR, default, strict=True)])

    def errors(self, axis: str, q: np.ndarray) -> np.ndarray:
        values = np.zeros((len(q), 6))
        for k, c in enumerate(COMPONENTS):
            for columns, rows in self.found:
                if c + axis in columns and columns[0] == axis:
                    values[:, k] += np.interp(q, rows[:, 0], rows[:, columns.index(c + axis)])
        fixed = np.array([self.constant(f"{c[1]}0{axis}") for c in COMPONENTS])
        if axis in LINEAR:
            values[:, :3] += fixed[:3] + q[:, None] * np.cross(fixed[3:], unit(axis))
            return values
        return values + fixed

    def factor(self, axis: str, q: np.ndarray, on_table: bool, with_errors: bool) -> np.ndarray:
        e = self.errors(axis, q) if with_errors else np.zeros((len(q), 6))
        if axis in LINEAR:
            return rigid(np.zeros(3), q[:, None] * unit(axis)) @ rigid(e[:, 3:], e[:, :3])
        centre, line = self.vector("P", axis, np.zeros(3)), self.vector("V", axis, unit(axis))
        own = -1.0 if on_table else 1.0
        turn = rigid(own * np.deg2rad(q)[:, None] * line, np.zeros(3), centre)
        return rigid(e[:, 3:], e[:, :3], centre) @ turn

    def pose(self, q: dict[str, np.ndarray], with_errors: bool) -> np.ndarray:
        table = tool = np.eye(4)
        for i, axis in enumerate(self.chain):
            if i < self.tables:  # from the machine to the workpiece: the one nearest the workpiece last
                table = self.factor(axis, q[axis], True, with_errors) @ table
            else:
                tool = tool @ self.factor(axis, q[axis], False, with_errors)
        return np.linalg.inv(table) @ tool

    def deviation(self, q: dict[str, np.ndarray]) -> np.ndarray:
        """Deviation of the functional point in the machine frame, (m, 3) [mm]."""
        tool = np.array([self.constant(f"P0{c}") for c in LINEAR])
        moved = apply(self.pose(q, True), tool) - apply(self.pose(q, False), tool)
        table = np.tile(np.eye(4), (len(moved), 1, 1))
        for axis in self.chain[: self.tables]:
            table = self.factor(axis, q[axis], True, False) @ table
        return np.einsum("mij,mj->mi", table[:, :3, :3], moved)
