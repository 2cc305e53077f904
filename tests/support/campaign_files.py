"""A tiny campaign as files, for tests of readers and checks: a three-axis machine, two stations, perfect readings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

MACHINE = """\
format = "volid-machine/1"
name = "Test machine"
structure = "w b X Y Z t"

[axis.X]
travel = [0.0, 1000.0]
[axis.Y]
travel = [0.0, 600.0]
[axis.Z]
travel = [-500.0, 0.0]
"""

MANIFEST = """\
format = "volid-campaign/1"
machine = "machine.toml"
title = "Acceptance"

[conditions]
ambient_temperature_C = 20.1
warm_up = "30 min axis cycle"
active_compensations = ["L-POS"]
component_temperatures_C = { bed = 20.3, column = 20.9 }

[[station]]
name = "S1"
position = [-150.0, 80.0, -700.0]

[[station]]
name = "S2"
position = [1200.0, 650.0, -650.0]
known = true
frame = "machine"

[[set]]
name = "volume"
kind = "distance"
file = "volume.csv"
tool = [0.0, 0.0, -150.0]
u = { constant = 0.0003, proportional = 3.0e-7 }
[[set.effect]]
name = "refraction"
type = "scale"
u = 2.0e-7
per = "station"
distribution = "rectangular"

[[set]]
name = "levels"
kind = "component"
file = "levels.csv"
tool = [0.0, 0.0, 0.0]
u = 2.0e-6
"""

STATIONS = {"S1": (-150.0, 80.0, -700.0), "S2": (1200.0, 650.0, -650.0)}
TOOL = (0.0, 0.0, -150.0)


def grid(n: int = 3) -> np.ndarray:
    """Axis positions X, Y, Z on a grid over the travels, shape (n³, 3) [mm]."""
    axes = [np.linspace(*travel, n) for travel in ((0.0, 1000.0), (0.0, 600.0), (-500.0, 0.0))]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def volume_rows(positions: np.ndarray | None = None) -> dict[str, list[Any]]:
    """Columns of a distance set from both stations, exact but for dead paths of -80 mm and -95 mm."""
    q = grid() if positions is None else positions
    names = np.repeat(list(STATIONS), len(q))
    targets = np.tile(q + TOOL, (len(STATIONS), 1))
    distance = np.linalg.norm(targets - np.array([STATIONS[name] for name in names]), axis=1)
    distance -= np.where(names == "S1", 80.0, 95.0)
    x, y, z = np.tile(q, (len(STATIONS), 1)).T.tolist()
    return {"X": x, "Y": y, "Z": z, "station": names.tolist(), "segment": ["1"] * len(x), "distance": distance.tolist()}


def level_rows() -> dict[str, list[Any]]:
    """Columns of a component set: roll of X read with a level, forward and backward."""
    x = [0.0, 250.0, 500.0, 750.0, 1000.0]
    value = [0.0, 3e-6, 8e-6, 4e-6, -1e-6, -2e-6, 5e-6, 9e-6, 4.5e-6, 0.5e-6]
    return {
        "X": x + x[::-1],
        "Y": [300.0] * 10,
        "Z": [-250.0] * 10,
        "X_dir": [1] * 5 + [-1] * 5,
        "component": ["A"] * 10,
        "value": value[:5] + value[:4:-1],
        "time": [float(10 * i) for i in range(10)],
    }


def edited(text: str, old: str, new: str) -> str:
    """The text with `old` replaced once; it must be there."""
    assert old in text
    return text.replace(old, new, 1)


def csv_text(columns: Mapping[str, list[Any]]) -> str:
    """The columns as CSV text, numbers with all their digits."""
    lines = [",".join(columns)]
    lines += [",".join(str(cell) for cell in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join(lines) + "\n"


def write_files(folder: Path, **texts: str) -> Path:
    """Write the campaign into `folder` and return the manifest's path.

    `texts` replace whole files: machine, manifest, volume, levels.
    """
    files = {"machine.toml": MACHINE, "campaign.toml": MANIFEST}
    files |= {"volume.csv": csv_text(volume_rows()), "levels.csv": csv_text(level_rows())}
    names = {"machine": "machine.toml", "manifest": "campaign.toml", "volume": "volume.csv", "levels": "levels.csv"}
    for key, text in texts.items():
        files[names[key]] = text
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder / "campaign.toml"
