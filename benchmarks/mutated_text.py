"""Damaged text files: no exception but volid's own, nothing above 10 s, nothing above 1 GB.

python -m benchmarks.mutated_text 25000           # so many, from number 0 on; one to two minutes of processor time
python -m benchmarks.mutated_text 100 --from 700  # numbers 700 … 799; a number always damages the same file in the same way

Manifests, machine files, studies, CSV files of every kind, tables, grids and networks; one in fifteen is fitted when it can be
read (`tests/support/mutated_text.py`). Exit status 1 when something is wrong, which is printed whole.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
from collections import Counter
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.mutated_text import trial


def main() -> int:
    """Damage and read; print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=int, metavar="N", help="how many")
    parser.add_argument("--from", type=int, default=0, dest="first", metavar="N", help="number of the first; default 0")
    args = parser.parse_args()
    found, results, slowest, began = Counter(), Counter(), (0.0, 0), time.process_time()
    for number in range(args.first, args.first + args.files):
        outcome = trial(number)
        results[outcome.result] += 1
        slowest = max(slowest, (outcome.seconds, number))
        if outcome.fault:
            found[outcome.fault.strip().splitlines()[-1][:100]] += 1
            print(f"--- {number}, {outcome.original}, {outcome.seconds:.1f} s\n{outcome.fault}", flush=True)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(f"{args.files} files: {dict(results.most_common())}")
    print(
        f"slowest {slowest[0]:.1f} s (number {slowest[1]}), memory {memory / 1e6:.0f} MB, {time.process_time() - began:.0f} s"
    )
    print(f"faults: {sum(found.values())}")
    for last, count in found.most_common():
        print(f"  {count}  {last}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
