"""Makes this SYNTHETIC positioning test again, byte for byte: python make.py [FOLDER].

Everything is a closed form in whole steps of 0.1 µm or 0.1 arc sec, so that every quantity of ISO 230-2 can be computed by hand:
mean deviations as below, and five approaches that lie -2, -1, 0, 1, 2 times a step a_i about the mean, whose standard deviation
is a_i sqrt(2.5). README.md says what is in which file.
"""

import sys
from decimal import Decimal
from pathlib import Path

HERE = Path(__file__).resolve().parent
ORDER = ((-2, 1, 0, 2, -1), (1, -2, 2, -1, 0), (0, 2, -1, -2, 1))  # of the approaches about their mean, taken in turn

# Axis X: targets (i - 1) 100 mm + r_i; mean deviations and steps a_i in 0.1 µm
X_TARGETS = ("3.1", "108.4", "201.7", "306.2", "400.9", "507.3", "602.5", "709.8", "804.6", "901.2", "997.4")
X_UP = (0, 12, 31, 44, 40, 52, 75, 81, 78, 96, 110)
X_DOWN = (-21, -12, 4, 20, 19, 26, 48, 60, 55, 64, 84)
X_STEPS = {1: (4, 3, 3, 5, 4, 3, 6, 4, 3, 4, 5), -1: (3, 4, 3, 4, 6, 3, 4, 5, 3, 4, 4)}

# Axis C: targets over the whole turn in degrees; mean deviations and steps in 0.1 arc sec
C_TARGETS = ("0.4", "46.1", "88.7", "134.9", "181.3", "224.6", "271.8", "313.2", "358.9")
C_UP = (0, 23, 41, 35, 10, -18, -37, -30, -4)
C_DOWN = (-15, 10, 30, 22, -6, -31, -52, -43, -17)
C_STEPS = {1: (3, 4, 3, 5, 3, 3, 4, 3, 3), -1: (4, 3, 3, 3, 5, 3, 3, 4, 3)}
U = "0.0001"  # mm, of a reading of X


def approaches(mean: int, step: int, target: int, direction: int) -> list[int]:
    """Five deviations about a mean, in steps of 0.1."""
    order = ORDER[(target + (direction < 0)) % len(ORDER)]
    return [mean + step * k for k in order]


def deviations(axis: str) -> dict[int, list[list[int]]]:
    """By direction, for every target its five deviations, in 0.1 µm or 0.1 arc sec."""
    means, steps = {"X": ({1: X_UP, -1: X_DOWN}, X_STEPS), "C": ({1: C_UP, -1: C_DOWN}, C_STEPS)}[axis]
    return {
        way: [approaches(m, a, i, way) for i, (m, a) in enumerate(zip(means[way], steps[way], strict=True))]
        for way in (1, -1)
    }


def long_rows() -> list[str]:
    """X as one row for each approach, in the order of the test: up to the last target, and back."""
    found, rows = deviations("X"), ["target,direction,run,actual"]
    for run in range(5):
        for way in (1, -1):
            for i in range(len(X_TARGETS))[::way]:
                actual = Decimal(X_TARGETS[i]) + Decimal(found[way][i][run]) / 10000
                rows.append(f"{X_TARGETS[i]},{way:+d},{run + 1},{actual:.4f}")
    return rows


def wide_rows(axis: str, targets: tuple[str, ...], title: str, unit: str) -> list[str]:
    """One row for each target, deviations in `unit`, which is that of ten steps."""
    names = [f"{way}_{run} [{unit}]" for way in ("up", "down") for run in range(1, 6)]
    found = deviations(axis)
    cells = [[Decimal(v) / 10 for way in (1, -1) for v in found[way][i]] for i in range(len(targets))]
    rows = [f"{t},{','.join(f'{v:.1f}' for v in row)}" for t, row in zip(targets, cells, strict=True)]
    return [f"{title},{','.join(names)}", *rows]


def campaign_rows() -> list[str]:
    """X as a set of kind component, in the order of the test, with the time in seconds."""
    found, rows = deviations("X"), ["X,X_dir,component,run,value,u,time"]
    for run in range(5):
        for way in (1, -1):
            for i in range(len(X_TARGETS))[::way]:
                value = Decimal(found[way][i][run]) / 10000
                rows.append(f"{X_TARGETS[i]},{way:+d},X,{run + 1},{value:.4f},{U},{10 * len(rows)}")
    return rows


def write(folder: Path) -> None:
    """Write the CSV files into `folder`; the TOML files are written by hand."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {
        "X.csv": long_rows(),
        "X_wide.csv": wide_rows("X", X_TARGETS, "target [mm]", "µm"),
        "C_wide.csv": wide_rows("C", C_TARGETS, "target [deg]", "arcsec"),
        "X_set.csv": campaign_rows(),
    }
    for name, rows in files.items():
        text = "\n".join(["# SYNTHETIC, made by make.py: no machine was measured", *rows]) + "\n"
        (folder / name).write_bytes(text.encode())


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
