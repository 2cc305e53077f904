"""Turns the published compensation tables into this campaign, byte for byte: python make.py [FOLDER].

The tables hold INCREMENTAL compensation values; deviation = -(their running sum). README.md tells how each direction is read.
"""

import sys
from decimal import Decimal
from itertools import accumulate
from math import sqrt
from pathlib import Path

HERE = Path(__file__).resolve().parent
STEP = 25  # mm
RUNS = 5  # approaches of every position, per direction
UNKNOWN = {"X": 250, "Y": 100, "Z": 175}  # mm: where the other axes stood is not published; mid-travel

# As printed, µm, every 25 mm from 0
TABLES = {
    "X": {
        1: "0 0.751 1.488 1.467 0.962 1.056 2.622 0.352 1.726 2.162 0.514 2.227 1.786 2.099 1.688 2.104 2.634 0.904 "
        "1.715 2.486 -0.245",
        -1: "-0.716 1.014 1.512 1.668 1.44 1.132 2.605 0.133 1.75 2.112 0.621 2.058 1.723 1.718 1.848 2.137 2.787 1.085 "
        "2.087 2.394 -0.251",
    },
    "Z": {
        1: "0 -1.281 2.286 2.52 0.642 4.234 0.781 4.135 4.808 3.009 4.32 1.578 2.525 0.878",
        -1: "-2.079 -0.801 1.827 2.029 0.547 4.558 1.02 4.912 4.693 3.214 4.313 1.698 2.784 0.737",
    },
}
REPEATABILITY = {"X": {1: 4.2, -1: 2.6}, "Z": {1: 3.9, -1: 4.0}}  # R up, R down = largest 4 s, µm


def deviations(axis: str, direction: int) -> list[Decimal]:
    """Mean deviations [mm] at 0, 25, 50, … mm in one direction (+1 forward, -1 reverse)."""
    increments = [Decimal(value) for value in TABLES[axis][direction].split()]
    return [-total / 1000 for total in accumulate(increments)]


def standard_uncertainty(axis: str, direction: int) -> float:
    """u of the mean of five approaches [mm]: s / sqrt(5), s = R / 4."""
    return REPEATABILITY[axis][direction] / 4 / sqrt(RUNS) / 1000


def rows(axis: str) -> list[str]:
    """Rows of the CSV file of one axis, forward then reverse."""
    result = []
    for direction in (1, -1):
        for i, value in enumerate(deviations(axis, direction)):
            places = [str(i * STEP if letter == axis else place) for letter, place in UNKNOWN.items()]
            u = standard_uncertainty(axis, direction)
            result.append(f"{','.join(places)},{direction:+d},{axis},{value:.6f},{u:.6f}")
    return result


def write(folder: Path) -> None:
    """Write X.csv and Z.csv into `folder`; campaign.toml and machine.toml are written by hand."""
    folder.mkdir(parents=True, exist_ok=True)
    for axis in TABLES:
        header = ["# Mean deviations after Harja and Candra; made by make.py from their tables; mm", ""]
        header[1] = f"X,Y,Z,{axis}_dir,component,value,u"
        (folder / f"{axis}.csv").write_bytes(("\n".join([*header, *rows(axis)]) + "\n").encode())


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
