"""What becomes of damaged HDF5 files, and of damaged files in the folders of interrupted runs: `tests/support/damaged_hdf5.py`.

python -m benchmarks.damaged_hdf5 6000              # ten minutes on one core
python -m benchmarks.damaged_hdf5 6000 --seed 7     # others

Exit status 1 when a file ends in a traceback, takes longer than 10 s or more than 1 GB, or when other contents come out of a file
that has a checksum.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("JAX_PLATFORMS", "cpu")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.damaged_hdf5 import MEMORY, Outcome, make_sources, run, tasks

RESULTS = ("refused", "right", "changed", "traceback", "hang", "crash")


def failed(outcome: Outcome) -> bool:
    """Whether an outcome must not be."""
    noticed = outcome.task.state == "checksum" and outcome.result == "changed"
    return noticed or outcome.result in ("traceback", "hang", "crash")


def main() -> int:
    """Damage, read, count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("number", type=int, help="of files")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        make_sources(Path(folder))
        found = list(run(tasks(args.number, args.seed), Path(folder)))
    outcomes = [o for o in found if isinstance(o, Outcome)]
    peak = max((o for o in found if not isinstance(o, Outcome)), default=0.0)
    for outcome in filter(failed, outcomes):
        print(outcome.task, outcome.how, outcome.result, outcome.text, sep="\n  ")
    print("| checksum | damage | files | " + " | ".join(RESULTS) + " |\n" + "|---" * (3 + len(RESULTS)) + "|")
    for state, damage in dict.fromkeys((o.task.state, o.task.damage) for o in outcomes):
        counts = Counter(o.result for o in outcomes if (o.task.state, o.task.damage) == (state, damage))
        print(f"| {state} | {damage} | {counts.total()} | " + " | ".join(str(counts[r]) for r in RESULTS) + " |")
    print(f"longest {max(o.seconds for o in outcomes):.1f} s, largest memory {peak / 1e6:.0f} MB")
    return int(any(map(failed, outcomes)) or peak > MEMORY)


if __name__ == "__main__":
    sys.exit(main())
