"""Makes this SYNTHETIC campaign and its truth again, byte for byte: python make.py [FOLDER].

Needs NumPy and SciPy only: machine, separation and control are those of tests/exact_chain/, which shares no code with volid.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from exact_chain import step_cases  # noqa: E402

SEED = 1


def write(folder: Path) -> None:
    """Write all files of the dataset but README.md and this program into `folder`."""
    step_cases.write(folder, step_cases.CASES["900"], SEED)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
