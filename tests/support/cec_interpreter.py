"""What a SINUMERIK does with assignments of $AN_CEC, written from the manual alone (6FC5397-1BP40-3BA1 pp. 244-252).

Values of all tables of an output axis are added. DIRECTION: 0 always, +1 and -1 in that direction of the input axis. A table with
MULT_BY_TABLE = n adds the product of its value with that of the table of index n - 1. Linear between points, ends held.
"""

import re
from collections import defaultdict

import numpy as np


class Tables:
    """The tables of a file, by index: variables by suffix, and the points."""

    def __init__(self, text: str) -> None:
        self.variables: dict[int, dict[str, str]] = defaultdict(dict)
        self.points: dict[int, dict[int, float]] = defaultdict(dict)
        for line in text.splitlines():
            found = re.match(r"\$AN_CEC(?:_(\w+))?\[(\d+)(?:,(\d+))?\]=([^;]*)", line)
            if found and found[1]:
                self.variables[int(found[2])][found[1]] = found[4].strip()
            elif found:
                self.points[int(found[2])][int(found[3])] = float(found[4])

    def value(self, t: int, positions: dict[str, np.ndarray], ways: dict[str, np.ndarray]) -> np.ndarray:
        """The value of one table at positions and directions by machine axis."""
        v = self.variables[t]
        axis, step, low = v["INPUT_AXIS"].strip("()"), float(v["STEP"]), float(v["MIN"])
        last = round((float(v["MAX"]) - low) / step)
        place = np.clip((positions[axis] - low) / step, 0.0, last)
        cell = np.minimum(np.floor(place).astype(int), last - 1)
        points = np.array([self.points[t][n] for n in range(last + 1)])
        linear = points[cell] + (place - cell) * (points[cell + 1] - points[cell])
        way = int(v.get("DIRECTION", "0"))
        return linear if way == 0 else np.where(ways[axis] == way, linear, 0.0)

    def total(self, output: str, positions, ways) -> np.ndarray:
        """What all tables of an output axis give together."""
        found = 0.0 * next(iter(positions.values()))
        for t, v in self.variables.items():
            if v["OUTPUT_AXIS"] == f"({output})":
                own, by = self.value(t, positions, ways), int(v.get("MULT_BY_TABLE", "0"))
                found = found + own + (own * self.value(by - 1, positions, ways) if by else 0.0)
        return found
