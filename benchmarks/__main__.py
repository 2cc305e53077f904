"""`python -m benchmarks`: runs the cases, each in a process of its own, prints the table, writes JSON, compares with a baseline.

python -m benchmarks --quick                     # smaller rounds, a few minutes
python -m benchmarks                             # everything
python -m benchmarks fit-S fit-M                 # some cases
python -m benchmarks --compare benchmarks/baseline.json
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np  # before volid: BLAS of the peers gets every processor, volid holds it to one thread for itself

NAMES = (
    "process", "fit-S", "fit-M", "fit-L", "fit-L-lines", "fit-L-streamed", "fit-five-axis", "fit-mixed",
    "whole-S", "whole-M", "whole-five-axis",
    "monte-carlo-S", "monte-carlo-M", "monte-carlo-bundled", "monte-carlo-million", "grid", "bands", "dask",
)  # fmt: skip
SLOWER = 1.3  # below this ratio two runs are no different
BASELINE = Path(__file__).parent / "baseline.json"


def measure(name: str, quick: bool) -> list[dict[str, Any]]:
    """Rows of one case, in this process."""
    from benchmarks.measure import load

    before = load()
    rows = [row.as_json() for row in _rows(name, quick)]
    return [row | {"name": name, "load": {"before": before, "after": load()}} for row in rows]


def _rows(name: str, quick: bool) -> Any:
    from benchmarks import cluster, fits, grids, monte_carlo, process

    kind, _, what = name.partition("-")
    if name == "process":
        return process.process_rows(quick)
    if name == "grid":
        return [grids.grid_row(quick)]
    if name == "bands":
        return [grids.bands_row(quick)]
    if name == "fit-L-streamed":
        return [fits.streamed_row(quick)]
    if name == "dask":
        return [cluster.cluster_row(quick)]
    if name == "monte-carlo-million":
        return [monte_carlo.million_row(quick)]
    if name.startswith("monte-carlo-"):
        return [monte_carlo.monte_carlo_row(name.removeprefix("monte-carlo-"), quick)]
    if kind == "whole":
        return [fits.whole_fit_row(what, quick)]
    if what.startswith("L"):
        return [fits.large_row(what.replace("-", " "), quick)]
    return [fits.fit_row({"five-axis": "five-axis R-test", "mixed": "mixed five-axis"}.get(what, what), quick)]


def apart(name: str, quick: bool) -> list[dict[str, Any]]:
    """Rows of one case, measured in a process of its own, so that its peak memory is its own."""
    command = [sys.executable, "-m", "benchmarks", "--here", name, *(["--quick"] if quick else [])]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    if found.returncode:
        said = [line for line in found.stderr.splitlines() if "Error" in line] or found.stderr.splitlines()
        return [{"name": name, "case": name, "failed": said[-1] if said else f"exit status {found.returncode}"}]
    rows: list[dict[str, Any]] = json.loads(found.stdout.splitlines()[-1])
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as text: volid, each peer with its ratio and the ratio's range, limit, share of the limit, peak memory."""
    lines = []
    for r in rows:
        if "failed" in r:
            lines.append(f"{r['case']}: FAILED, {r['failed']}")
            continue
        memory = f", peak {r['memory_mb']:.0f} MB" if r["memory_mb"] else ""
        lines.append(f"{r['case']}: volid {seconds(r['volid'])}{memory}")
        for peer, (middle, low, high) in r["ratios"].items():
            far = f", {r['accuracy'][peer]:.0e} u" if peer in r["accuracy"] else ""
            lines.append(
                f"    {peer:<28} {seconds(r['peers'][peer]):>10}  {middle:7.2f} x ({low:.2f} … {high:.2f}){far}"
            )
        if r["limit"] and r["limit_of"]:
            lines.append(
                f"    limit: {r['limit_of']:<21} {seconds(r['limit']):>10}  {100 * r['share_of_limit']:.0f} % reached"
            )
        own = r["accuracy"].get("volid")
        lines += [f"    volid lies {own:.0e} u from the minimum"] if own is not None else []
        lines += [f"    start-up: {k} {seconds(v)}" for k, v in r["start_up"].items()] + [
            f"    {n}" for n in r["notes"]
        ]
        lines.append(f"    load average before {r['load']['before'][0]}, after {r['load']['after'][0]}")
    return "\n".join(lines)


def seconds(t: float) -> str:
    """A duration for people."""
    return f"{1e3 * t:.1f} ms" if t < 1.0 else f"{t:.2f} s"


def compare(rows: list[dict[str, Any]], baseline: list[dict[str, Any]]) -> list[str]:
    """Regressions: ratios to a peer, or the share of the limit, worse than the baseline by more than `SLOWER`.

    Ratios of one run stand beside ratios of another run: absolute times of two machines, or loads, do not compare.
    """
    known = {r["case"]: r for r in baseline if "failed" not in r}
    found = []
    for r in rows:
        old = known.get(r["case"])
        if "failed" in r:
            found.append(f"{r['case']}: failed, {r['failed']}")
            continue
        for peer, (middle, *_) in r["ratios"].items() if old else ():
            before = old["ratios"].get(peer, (0.0,))[0] if old else 0.0
            if middle * SLOWER < before:
                found.append(f"{r['case']}: {middle:.2f} x {peer}, {before:.2f} x in the baseline")
        if old and old.get("limit") and r.get("limit") and r["share_of_limit"] * SLOWER < old["share_of_limit"]:
            now, before = (100 * x["share_of_limit"] for x in (r, old))
            found.append(f"{r['case']}: {now:.0f} % of the limit, {before:.0f} % in the baseline")
    return found


def main() -> int:
    """0; 1 when a comparison finds a regression or a case fails."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__.splitlines()[0] if __doc__ else ""
    )
    parser.add_argument("names", nargs="*", metavar="CASE", help=f"cases, all by default: {', '.join(NAMES)}")
    parser.add_argument("--quick", action="store_true", help="fewer rounds and smaller cases, without L")
    parser.add_argument(
        "--compare", metavar="BASELINE.json", help="name what became slower than in this file; exit status 1"
    )
    parser.add_argument("-o", "--output", default="benchmarks/result.json", help="JSON; default benchmarks/result.json")
    parser.add_argument("--here", metavar="CASE", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.here:
        print(json.dumps(measure(args.here, args.quick)))
        return 0
    unknown = [n for n in args.names if n not in NAMES]
    if unknown:
        parser.error(f"unknown case {', '.join(unknown)}; expected some of {', '.join(NAMES)}")
    rows = []
    for name in args.names or [n for n in NAMES if not (args.quick and n.startswith("fit-L"))]:
        new = apart(name, args.quick)
        rows += new
        print(table(new), flush=True)
    record = {
        "machine": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "numpy": np.__version__,
        "quick": args.quick,
        "rows": rows,
    }
    Path(args.output).write_text(json.dumps(record, indent=1), encoding="utf-8")
    slower = compare(rows, json.loads(Path(args.compare).read_text(encoding="utf-8"))["rows"]) if args.compare else []
    print("\n".join(["", "slower than the baseline:", *slower] if slower else []))
    return 1 if slower or any("failed" in r for r in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
