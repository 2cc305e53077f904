"""Files as instruments and other programs write them, composed here from the layouts that are publicly described.

No file of a maker is among them. Numbers are made up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

TARGETS = tuple(np.linspace(0.0, 1000.0, 11))
MEASURED = {"tool": [0.0, 0.0, -150.0], "u": 5e-4}
ENVIRONMENT = (
    "Air temp   : 20.337280 20.384956 0",
    "Air press  : 99.039005 99.049346 1",
    "Air humid  : 46.954897 46.893887",
    "Mat temp 1 : 20.200000 20.300000 0",
    "Mat temp 2 : -10.000000 -10.000000 0",
    "Mat temp 3 : 20.600000 20.700000 0",
    "Env factor : 0.31641096 0.31641067",
    "Exp coeff  : 8.000000 8.000000 0",
    'Date Time  : "10:46 Dec 12 2016" "11:01 Dec 12 2016"',
    "Final Data : 1 0",
)


def run_file(
    runs: Sequence[Sequence[float]],
    targets: Sequence[float] = TARGETS,
    *,
    file_type: str = "rtl",
    flags: str = "0 0 2 0",
    axis: str = "X",
    environment: Sequence[str] = ENVIRONMENT,
) -> str:
    """Runs along targets: odd ones from the first target to the last, even ones back; each run's deviations in target order."""
    rows = []
    for run, values in enumerate(runs, start=1):
        numbers = range(1, len(targets) + 1)
        rows += [f"{run}   {i}      {values[i - 1]:.6f}" for i in (numbers if run % 2 else reversed(numbers))]
    wrapped = [" ".join(f"{t:.6f}" for t in targets[i : i + 5]) + " " for i in range(0, len(targets), 5)]
    lines = ["HEADER::", f"File type  : {file_type}", "Owner      : Workshop", "Version no : V20.02.02", ""]
    lines += [
        "TARGET DATA::",
        "Filetype  : ISO",
        f"Target-count: {len(targets)}",
        "Targets :",
        *wrapped,
        f"Flags: {flags}",
        "",
    ]
    lines += [
        "USER-TEXT::",
        "Machine: Mill",
        "Serial No: 17",
        "Date: 2026-03-21",
        "By: NN",
        f"Axis: {axis}",
        "TITLE: made up",
    ]
    lines += ["", "RUNS::", f"Run-count: {len(runs)}", "", "DEVIATIONS::", "Run Target Data:", *rows, ""]
    lines += ["ENVIRONMENT::", *environment, ""] if environment else []
    return "\r\n".join([*lines, "EOF::", ""])


def averages_file(forward: Sequence[float], back: Sequence[float], targets: Sequence[float] = TARGETS) -> str:
    """Averages of runs in tables, in mm."""
    both = [(a + b) / 2 for a, b in zip(forward, back, strict=True)]
    tables = {"Bidirectional": both, "Forward Directional": forward, "Reverse Directional": back}
    lines = ["TARGET DATA::", "Targets :", " ".join(map(str, targets)), "Flags: 0 0 2 0", "", "RUNS::"]
    for title, values in tables.items():
        lines += [
            f"Position   \t{title} Avg Error",
            *(f"{t:.3f}\t{v:.7f}" for t, v in zip(targets, values, strict=True)),
            "",
        ]
    return "\r\n".join([*lines, "ENVIRONMENT::", ""])


FEATURES = (
    ("AF_SQUARENESS", "UT_SQUARENESS", "-12.5"),
    ("AF_SCALE_MISMATCH", "UT_LENGTH_UM", "3.4"),
    ("AF_BACKLASH_A_POS", "UT_LENGTH_UM", "1.5"),
    ("AF_SERVO_MISMATCH", "UT_SERVO_MISMATCH", "0.02"),
)


def ball_bar_file(features: Sequence[tuple[str, str, str]] = FEATURES, plane: str = "XY") -> str:
    """An evaluated ball-bar test."""
    inner = "\n".join(f'  <FEATURE NAME="{n}" DT="{t}">{v}</FEATURE>' for n, t, v in features)
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<TEST>\n <MACHINE_TESTED NAME="Mill"/>\n'
        f' <DATE_STARTED>2025-12-18</DATE_STARTED>\n <PLANE TEST_PLANE="{plane}"/>\n <FEATURES>\n{inner}\n '
        "</FEATURES>\n</TEST>\n"
    )


def _runs(scale: float) -> list[list[float]]:
    """Two runs up and two down with different deviations at every target."""
    return [[scale * (0.01 * i * i + 0.1 * run) for i in range(1, 12)] for run in (1, 2, 3, 4)]


@dataclass(frozen=True)
class Sample:
    """A sound file of a format, as text; `keys` that its set needs beside the format's name; `kind` of what comes of it.

    `kind` is empty for a file of results, which makes no set. `beside`: files that keys name, by their names.
    """

    text: str
    kind: str
    keys: dict[str, Any] = field(default_factory=dict)
    beside: dict[str, str] = field(default_factory=dict)

    def write_beside(self, folder: Path) -> None:
        """Write the files that keys name."""
        for name, text in self.beside.items():
            (folder / name).write_text(text, encoding="utf-8")


SPHERES = {"path A": (300.0, 200.0, -250.0), "path B": (420.0, 260.0, -180.0)}  # mm, axis positions of the centres
TOUCHED = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0.6, 0, 0.8), (0, -0.6, 0.8))
RADIUS, BALL = 12.5, 2.5  # mm


def _touches() -> list[tuple[str, float, float, float]]:
    """Path and centre of the stylus ball of every touch, some µm beside the spheres."""
    found = []
    for path, centre in SPHERES.items():
        for i, normal in enumerate(TOUCHED):
            r = RADIUS + BALL + 0.001 * (i % 3 - 1)
            found.append((path, *(float(c + r * n) for c, n in zip(centre, normal, strict=True))))
    return found


def touch_results() -> str:
    """Results of probing software: nominal and measured points of two tool paths."""
    lines, last = ["START", "DOCUMENTID 7"], ""
    for i, (path, x, y, z) in enumerate(_touches(), start=1):
        if path != last:
            lines += [f"TOOLPATH {path}", f"G330 N{i} A0 B0 C0 X0 Y0 Z0 I0 R0"]
        lines += [f"G800 N{i} X{x:.3f} Y{y:.3f} Z{z:.3f} I0 J0 K1", f"G801 N{i} X{x:.4f} Y{y:.4f} Z{z:.4f} R{BALL:.4f}"]
        last = path
    return "\n".join([*lines, "END", ""])


def touch_log() -> str:
    """A log of touches with nine numbers a line."""
    return "".join(f"{x:.6f} {y:.6f} {z:.6f}" + " 0.000000" * 6 + "\n" for _, x, y, z in _touches())


POINTS = [(x, y, z) for x in (100.0, 600.0) for y in (50.0, 350.0) for z in (-300.0, -50.0)]


def point_export() -> str:
    """Points of a tracker whose frame is shifted against the machine's."""
    rows = [f"Machine volume p{i} {x + 10:.4f} {y - 20:.4f} {z - 120:.4f}" for i, (x, y, z) in enumerate(POINTS)]
    return "\n".join(["// SpatialAnalyzer 2021.1", "// Units: Millimeters", *rows, ""])


def point_positions() -> str:
    """Where the machine was commanded to, by the names of the points."""
    return "\n".join(["target,X,Y,Z", *(f"p{i},{x},{y},{z}" for i, (x, y, z) in enumerate(POINTS)), ""])


_LINE = {"axis": "X", "at": {"Y": 300.0, "Z": -250.0}, **MEASURED}
SAMPLES = {
    "rtl": Sample(run_file(_runs(1.0)), "component", _LINE),
    "rta": Sample(run_file(_runs(0.001), file_type="rta"), "component", {**_LINE, "component": "B", "u": 1e-6}),
    "pos": Sample(averages_file(_runs(1e-3)[0], _runs(1e-3)[1]), "component", {**_LINE, "sign": 1}),
    "b5r": Sample(ball_bar_file(), ""),
    "msr": Sample(touch_results(), "displacement", {"tool": [0.0, 0.0, -150.0], "origin": [0.0, 0.0, -150.0]}),
    "linuxcnc": Sample(touch_log(), "displacement", {"tool": [0.0, 0.0, -150.0], "coordinates": "axes", "gap": 50.0}),
    "spatial_analyzer": Sample(
        point_export(), "point", {**MEASURED, "positions": "positions.csv"}, {"positions.csv": point_positions()}
    ),
}
