"""What a kinematics table with error lines says of the tool point, from the manual alone (iTNC 530 HSCI pp. 670-686, 722).

The table leads from the tool reference point to the workpiece; MachAxis moves what stands before it; Trans with COMPTAB is an
error, a constant or a column of the .COM of an axis; COM tables are linear between rows. Entries count as errors.
"""

import re
from itertools import pairwise

import numpy as np
from exact_chain import ExactMachine, apply, rigid

ROTATIONS = "ABC"


def columns(text: str) -> dict[str, list[str]]:
    """Cells by column name, from the places of the names."""
    lines = text.splitlines()
    starts = {m.group(): m.start() for m in re.finditer(r"\S+", lines[1])}
    return {
        n: [line[a:b].strip() for line in lines[2:-1]]
        for n, (a, b) in zip(starts, pairwise([*starts.values(), 200]), strict=True)
    }


class Chain:
    """The tables of a control and the nominal machine."""

    def __init__(self, machine: ExactMachine, files: dict[str, str]) -> None:
        self.machine = machine
        self.com = {name[0]: columns(text) for name, text in files.items() if name.endswith(".COM")}
        table = columns(files["VOLID.TAB"])
        self.lines = list(zip(*(table[c] for c in ("KEY", "AXIS", "COMPTAB")), strict=True))

    def value(self, entry: str, q: np.ndarray) -> np.ndarray:
        """An entry of COMPTAB at positions, (m,)."""
        if ".." not in entry:
            return np.full(len(q), float(entry))
        axis, column = entry.split("..")
        return self.of_column(axis, column, q)

    def of_column(self, axis: str, column: str, q: np.ndarray) -> np.ndarray:
        table = self.com[axis]
        x, y = (np.array([float(v) for v in table[c]]) for c in ("AXISPOS", column))
        return np.interp(q[:, self.machine.column(axis)], x, y)

    def point(self, q: np.ndarray, tool: np.ndarray) -> np.ndarray:
        """The tool point in the workpiece frame, (m, 3) [mm]."""
        at = np.tile(np.asarray(tool, float), (len(q), 1))
        for key, axis, entry in self.lines:
            if key == "MachAxis":
                at = apply(self.machine.nominal_factor(axis, self.moved(axis, q)), at)
            elif key == "Trans":
                size = self.value(entry, q)[:, None] * np.eye(3)["XYZABC".index(axis) % 3]
                turn, shift = (np.deg2rad(size), 0.0 * size) if axis in ROTATIONS else (0.0 * size, size)
                at = apply(rigid(turn, shift), at)
        return at

    def moved(self, axis: str, q: np.ndarray) -> np.ndarray:
        """Positions with the positioning error of the axis itself, the column of its own name."""
        there = np.array(q)
        if axis in self.com and axis in self.com[axis]:
            there[:, self.machine.column(axis)] += self.of_column(axis, axis, q)
        return there
