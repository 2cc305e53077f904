"""Whole processes of the command line, against a bare `import jax` in the same run."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import volid
from benchmarks.cases import distances, rtest_readings
from benchmarks.measure import REPEATS, Row, interleaved, peak_memory

CAMPAIGN = "datasets/vertical_multilateration/campaign.toml"


def _run(command: list[str], **environment: str) -> None:
    """A process that has to succeed."""
    unusual = ("OPENBLAS_NUM_THREADS", "PYTHONDONTWRITEBYTECODE")  # users have the bytecode that pip makes
    own = {k: v for k, v in os.environ.items() if k not in unusual}
    done = subprocess.run(command, env=own | environment, check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{command}: exit status {done.returncode}: {done.stderr}")


SIZES = (1_200, 2_400, 12_000, 20_000, 100_000, 1_000_000)
LARGE = 100_000  # distances from which a campaign takes part in two rounds, and in none of a quick run


def _campaigns(folder: Path, quick: bool) -> dict[str, Path]:
    """HDF5 campaigns by name: distances with automatic splines, as a standard plan has them, and an R-test on five axes."""
    found = {}
    for m in SIZES:
        if not (quick and m >= LARGE):
            found[f"{m:,} distances"] = folder / f"distances_{m}.h5"
            volid.save_campaign(distances(m), found[f"{m:,} distances"])
    test = rtest_readings()
    found[f"R-test, {test.n_readings:,} readings"] = folder / "rtest.h5"
    volid.save_campaign(test, folder / "rtest.h5")
    return found


def process_rows(quick: bool) -> list[Row]:
    """`volid fit` for the first time and with its cache, for campaigns of all sizes, and `volid --help`."""
    folder = Path(tempfile.mkdtemp(prefix="volid-benchmark-"))
    python, output = sys.executable, str(folder / "solution.h5")
    bare = {
        "import jax": lambda: _run([python, "-c", "import jax"]),
        "volid --help": lambda: _run([python, "-m", "volid", "--help"]),
    }

    def fits(name: str, path: Path | str) -> dict[str, Callable[[], None]]:
        """The first fit of a machine, with nothing in the cache, and a later one."""
        cache = folder / f"cache of {name}"
        command = [python, "-m", "volid", "fit", str(path), "-o", output, "--force"]

        def first() -> None:
            shutil.rmtree(cache, ignore_errors=True)
            _run(command, XDG_CACHE_HOME=str(cache))

        later = partial(_run, command, XDG_CACHE_HOME=str(cache))
        return {f"volid fit{name}, first ever": first, f"volid fit{name}, with cache": later}

    campaigns = _campaigns(folder, quick)
    large = {n: p for n, p in campaigns.items() if n in {f"{m:,} distances" for m in SIZES if m >= LARGE}}
    small = {n: p for n, p in campaigns.items() if n not in large}
    contestants = bare | fits("", CAMPAIGN)
    for name, path in small.items():
        contestants |= fits(f" {name}", path)
    rows = _rows(interleaved(contestants, 2 if quick else REPEATS, patience=np.inf))
    for name, path in large.items():  # apart: the others need not wait for them in every round
        rows += _rows(interleaved({"import jax": bare["import jax"], **fits(f" {name}", path)}, 2, patience=np.inf))
    shutil.rmtree(folder, ignore_errors=True)
    return rows


def _rows(times: dict[str, np.ndarray]) -> list[Row]:
    """A line for each process: its time, and how often a bare `import jax` of the same round goes into it."""
    rows = []
    base = times.pop("import jax")
    for name, own in times.items():
        share = sorted((own / base).tolist())
        middle = share[len(share) // 2]
        row = Row(name, sorted(own.tolist())[len(own) // 2], memory_mb=peak_memory())
        row.peers = {"import jax": sorted(base.tolist())[len(base) // 2]}
        row.ratios = {"import jax": (1.0 / middle, 1.0 / share[-1], 1.0 / share[0])}
        row.notes = [f"{middle:.2f} ({share[0]:.2f} … {share[-1]:.2f}) times a bare import jax"]
        rows.append(row)
    return rows
