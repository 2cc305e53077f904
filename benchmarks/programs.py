"""Programs of G-code corrected in advance: how closely the new path is followed, how many blocks it takes, how long it takes.

python -m benchmarks.programs --motions 400     # random lines, arcs and helices on the exact machine; one minute
python -m benchmarks.programs --speed           # programs of 200,000 lines; a minute

The machine is the exact chain of the tests with random errors four times those of a good one, its grid has nodes at random
distances, and programs have another tool than the grid. "Path": largest distance of the new path, corrections undone with the
grid as SciPy interpolates it, from the programmed path, over the chord tolerance; it must not exceed 1, but for corrections of
corrections. "Point": largest distance of the functional point from the programmed path, over chord tolerance and the grid's own
error along that path together.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from exact_chain import ExactMachine, random_truth
from scipy.interpolate import RegularGridInterpolator
from support.gcode import dense, distances, lines_of

import volid

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
MACHINE = ExactMachine("w Y' X' b Z t", TRAVEL)
SIZES = np.array([21, 13, 11])
TOOL, GRID_TOOL = (20.0, -10.0, -180.0), (0.0, 0.0, -100.0)
OFFSETS = {"G54": (500.0, 300.0, -250.0)}
SECOND_ORDER = 2e-5  # mm, as in the tests
PLANES = {"G17": ("XYZ", "IJ"), "G18": ("ZXY", "KI"), "G19": ("YZX", "JK")}


class Case:
    """A machine with random errors and its grid."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.truth = random_truth(MACHINE, self.rng, scale=4.0)
        self.nodes = [
            np.r_[low, np.sort(self.rng.uniform(low, high, n - 2)), high]
            for (low, high), n in zip(TRAVEL.values(), SIZES, strict=True)
        ]
        mesh = np.stack([m.ravel(order="F") for m in np.meshgrid(*self.nodes, indexing="ij")], axis=1)
        values = self.exact(mesh, GRID_TOOL)
        self.grid = volid.Grid(
            "L-VOL", ("X", "Y", "Z"), tuple(self.nodes), mesh, values, values * np.nan, mesh[:, 0] > 1e9, GRID_TOOL, "machine", ""
        )  # fmt: skip
        self.table = RegularGridInterpolator(self.nodes, values.reshape(*SIZES, 6, order="F"))

    def exact(self, places: np.ndarray, tool=TOOL) -> np.ndarray:
        """Deviation (m, 6) of the exact machine."""
        return MACHINE.deviation(MACHINE.in_axis_order(dict(zip("XYZ", places.T, strict=True))), tool, self.truth)

    def by_grid(self, places: np.ndarray) -> np.ndarray:
        """Translations (m, 3) by the grid."""
        found = self.table(places)
        return found[:, :3] + np.cross(found[:, 3:], np.subtract(TOOL, GRID_TOOL))

    def line(self) -> tuple[str, np.ndarray]:
        """A program, and the path that it means, in its coordinates."""
        a, b = (self.rng.uniform((-400, -200, -200), (400, 200, 200)) for _ in range(2))
        text = f"{_words(a)}\nG1 {_words(b)} F1000"
        return text, a + np.linspace(0, 1, 20_001)[:, None] * (b - a)

    def arc(self) -> tuple[str, np.ndarray]:
        """The same for an arc or a helix in any plane."""
        plane = list(PLANES)[self.rng.integers(3)]
        axes, letters = PLANES[plane]
        k = ["XYZ".index(c) for c in axes]
        radius, begin = self.rng.uniform(2, 150), self.rng.uniform(0, 2 * np.pi)
        sweep = self.rng.uniform(0.05, 2 * np.pi) * self.rng.choice([-1, 1])
        share = np.linspace(0, 1, 20_001)
        centre, rise = self.rng.uniform(-40, 40, 3), self.rng.uniform(-60, 60) * self.rng.integers(2)
        path = np.zeros((len(share), 3))
        path[:, k[0]] = centre[k[0]] + radius * np.cos(begin + sweep * share)
        path[:, k[1]] = centre[k[1]] + radius * np.sin(begin + sweep * share)
        path[:, k[2]] = centre[k[2]] + rise * share
        to = [centre[k[i]] - path[0, k[i]] for i in range(2)]
        code = "G3" if sweep > 0 else "G2"
        middle = " ".join(f"{letter}{v:.7f}" for letter, v in zip(letters, to, strict=True))
        return f"{_words(path[0])}\n{plane} {code} {_words(path[-1])} {middle} F1000", path


def _words(place: np.ndarray) -> str:
    return " ".join(f"{letter}{v:.7f}" for letter, v in zip("XYZ", place, strict=True))


def trial(case: Case, shape: str, chord: float) -> tuple[float, float, int]:
    """Both ratios, and the blocks that a motion becomes."""
    text, path = getattr(case, shape)()
    setting = volid.ProgramSetting(offsets=OFFSETS, tool=TOOL, chord=chord)
    made = volid.apply_to_program(case.grid, f"G21 G90 G0 {text}\n", setting)
    ideal = path + np.array(OFFSETS["G54"])
    moves = [m for m in lines_of(made.text, OFFSETS, {}) if m[0] == 1]
    driven = np.concatenate([dense(np.stack([a, b]), 1.0) for _, a, b in moves])
    by_path = distances(driven + case.by_grid(driven), ideal).max()
    by_point = distances(driven + case.exact(driven)[:, :3], ideal).max()
    error = np.linalg.norm(case.exact(ideal)[:, :3] - case.by_grid(ideal), axis=1).max()
    return (by_path - SECOND_ORDER) / chord, (by_point - SECOND_ORDER) / (chord + error), len(moves)


def follow(motions: int) -> None:
    """The table of how closely paths are followed."""
    print("| motions | chord / µm | path, largest | path, median | point, largest | blocks, median | blocks, most |")
    print("|---|---|---|---|---|---|---|")
    for shape in ("line", "arc"):
        for chord in (0.0005, 0.001, 0.005, 0.02):
            case = Case(round(1e5 * chord) + len(shape))
            path, point, blocks = np.array([trial(case, shape, chord) for _ in range(motions // 8)]).T
            print(
                f"| {motions // 8} {shape}s | {1e3 * chord:g} | {path.max():.2f} | {np.median(path):.2f} | {point.max():.2f} | "
                f"{np.median(blocks):.0f} | {blocks.max():.0f} |"
            )


def speed() -> None:
    """The table of times."""
    case, rng = Case(1), np.random.default_rng(1)
    near = np.clip(np.cumsum(rng.normal(0, 0.3, (200_000, 3)), axis=0), -150, 150)
    far = rng.uniform((-400, -200, -200), (400, 200, 200), (20_000, 3))
    programs = {
        "200,000 lines of 0.5 mm": [f"X{a:.3f} Y{b:.3f} Z{c:.3f}" for a, b, c in near],
        "20,000 lines of 400 mm": [f"X{a:.3f} Y{b:.3f} Z{c:.3f}" for a, b, c in far],
        "10,000 circles of 5 to 10 mm radius": [f"G3 I{r:.3f} F800" for r in rng.uniform(5, 10, 10_000)],
    }
    print("| program | s | blocks after | largest distance / µm | memory / MB |")
    print("|---|---|---|---|---|")
    for name, rows in programs.items():
        text = "\n".join(["G21 G90 G0 X0 Y0 Z0", "G1 X0 F800", *rows, ""])
        began = time.process_time()
        made = volid.apply_to_program(case.grid, text, volid.ProgramSetting(offsets=OFFSETS, tool=TOOL))
        seconds = time.process_time() - began
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        after = f"{made.counted.blocks[1]:,}"
        print(f"| {name} | {seconds:.1f} | {after} | {1e3 * made.counted.chord:.2f} | {memory:.0f} |")


def main() -> None:
    """One of both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=int, default=400, metavar="N", help="random motions; default 400")
    parser.add_argument("--speed", action="store_true", help="times instead")
    args = parser.parse_args()
    speed() if args.speed else follow(args.motions)


if __name__ == "__main__":
    main()
