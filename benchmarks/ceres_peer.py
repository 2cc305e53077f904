"""The Ceres peer: builds `ceres/three_axis.cc` where Ceres is installed, and talks to it while it lives."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.cases import Case
from volid.model.error_model import LOCATION
from volid.model.splines import design_matrix

SOURCE = Path(__file__).parent / "ceres" / "three_axis.cc"
SOLVERS = ("dense", "sparse", "qr")
LIBRARIES = ("-lceres", "-lglog")


def build(folder: Path) -> Path | str:
    """The program, or the reason why there is none."""
    if shutil.which("g++") is None:
        return "no C++ compiler (g++)"
    program = folder / "three_axis"
    command = ["g++", "-O3", "-march=native", "-std=c++17", "-I/usr/include/eigen3", str(SOURCE), "-o", str(program)]
    found = subprocess.run([*command, *LIBRARIES], capture_output=True, text=True, check=False)
    if found.returncode:
        return "Ceres is not installed (Debian: libceres-dev)" if "ceres/" in found.stderr else found.stderr[-300:]
    return program


def _numbers(case: Case) -> np.ndarray:
    """The case as the program reads it; see the head of its source."""
    problem, campaign, model = case.problem, case.campaign, case.problem.model
    readings = campaign.sets[0]
    names = [s.name for s in campaign.stations]
    parts: list[np.ndarray] = [np.array([len(readings), len(names)], dtype=float)]
    motions = [f for f in model.functions if f.part != LOCATION]
    for f in motions:
        p = model.parametrisation[f.coefficients, f.parameters]
        parts += [np.array([f.splines[0].axis, p.shape[1]], dtype=float), p.ravel()]
    parts.append(np.array([a.reference for a in campaign.machine.axes]))
    n = model.layout.n_coefficients
    stations = [[i for i, e in enumerate(problem.nuisance) if f" {s} " in e.name] for s in names]
    start = problem.start[n:]
    parts.append(np.zeros(model.n_parameters))
    order = [sorted(own, key=lambda i: problem.nuisance[i].name.startswith("dead")) for own in stations]
    parts += [start[own] for own in order]
    weights, first = [], []
    for a, axis in enumerate(campaign.machine.axes):
        spline = next(f.splines[0] for f in motions if f.splines[0].axis == a)
        dense = design_matrix(spline, readings.positions[:, a])
        t = (readings.positions[:, a] - axis.travel[0]) / axis.length * spline.segments
        at = np.clip(np.floor(t).astype(int), 0, spline.segments - 1)
        first.append(at)
        weights.append(np.take_along_axis(dense, at[:, None] + np.arange(4), axis=1))
    number = np.array([names.index(s) for s in readings.labels["station"]])
    columns = [np.array(first).T, *weights, readings.positions, readings.tool, number[:, None]]
    parts.append(np.hstack([*columns, readings.readings, 1.0 / readings.u]).ravel())
    return np.concatenate(parts)


class Ceres:
    """A living program with one case loaded; `solver` as in SOLVERS."""

    def __init__(self, program: Path, case: Case, solver: str, threads: int = 2) -> None:
        self.case = case
        with tempfile.NamedTemporaryFile(suffix=".bin", delete=False) as file:
            _numbers(case).tofile(file)
        self.file = Path(file.name)
        self.process = subprocess.Popen(
            [str(program), str(self.file), solver, str(threads)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def _ask(self, text: str) -> list[float]:
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()
        return [float(v) for v in self.process.stdout.readline().split()]

    def solve(self) -> tuple[float, float, int, np.ndarray]:
        """(seconds, cost, iterations, unknowns: θ and stations)."""
        answer = self._ask("solve")
        return answer[0], answer[1], int(answer[2]), np.array(answer[3:])

    def theta(self, unknowns: np.ndarray) -> np.ndarray:
        """θ of the model from the program's unknowns: they stand in the same order."""
        return unknowns[: self.case.problem.model.n_parameters]

    def loop(self, trials: int) -> float:
        """Seconds of `trials` fits of newly drawn readings, each begun at the solution."""
        return self._ask(f"loop {trials}")[0]

    def close(self) -> None:
        """End the program."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()
        self.file.unlink(missing_ok=True)
