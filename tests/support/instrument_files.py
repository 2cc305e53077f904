"""Files as instruments and other programs write them, composed here from the layouts that are publicly described.

No file of a maker is among them. Numbers are made up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
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
        f' <DATE_STARTED>2025-12-18</DATE_STARTED>\n <PLANE TEST_PLANE="{plane}"/>\n <FEATURES>\n{inner}\n </FEATURES>\n</TEST>\n'
    )


def _runs(scale: float) -> list[list[float]]:
    """Two runs up and two down with different deviations at every target."""
    return [[scale * (0.01 * i * i + 0.1 * run) for i in range(1, 12)] for run in (1, 2, 3, 4)]


@dataclass(frozen=True)
class Sample:
    """A sound file of a format, as text; `keys` that its set needs beside the format's name; `kind` of what comes of it.

    `kind` is empty for a file of results, which makes no set.
    """

    text: str
    kind: str
    keys: dict[str, Any] = field(default_factory=dict)


_LINE = {"axis": "X", "at": {"Y": 300.0, "Z": -250.0}, **MEASURED}
SAMPLES = {
    "rtl": Sample(run_file(_runs(1.0)), "component", _LINE),
    "rta": Sample(run_file(_runs(0.001), file_type="rta"), "component", {**_LINE, "component": "B", "u": 1e-6}),
    "pos": Sample(averages_file(_runs(1e-3)[0], _runs(1e-3)[1]), "component", {**_LINE, "sign": 1}),
    "b5r": Sample(ball_bar_file(), ""),
}
