"""Whole processes of the command line, against a bare `import jax` in the same run."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.measure import REPEATS, Row, interleaved, peak_memory

CAMPAIGN = "datasets/vertical_multilateration/campaign.toml"


def _run(command: list[str], **environment: str) -> None:
    """A process that has to succeed."""
    unusual = ("OPENBLAS_NUM_THREADS", "PYTHONDONTWRITEBYTECODE")  # users have the bytecode that pip makes
    own = {k: v for k, v in os.environ.items() if k not in unusual}
    done = subprocess.run(command, env=own | environment, check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{command}: exit status {done.returncode}: {done.stderr}")


def process_rows(quick: bool) -> list[Row]:
    """`volid fit` for the first time and with its cache, and `volid --help`."""
    folder = Path(tempfile.mkdtemp(prefix="volid-benchmark-"))
    python, output = sys.executable, str(folder / "solution.h5")
    fit = [python, "-m", "volid", "fit", CAMPAIGN, "-o", output, "--force"]

    def first() -> None:
        shutil.rmtree(folder / "cache", ignore_errors=True)
        _run(fit, XDG_CACHE_HOME=str(folder / "cache"))

    contestants = {
        "import jax": lambda: _run([python, "-c", "import jax"]),
        "volid --help": lambda: _run([python, "-m", "volid", "--help"]),
        "volid fit, first ever": first,
        "volid fit, with cache": lambda: _run(fit, XDG_CACHE_HOME=str(folder / "cache")),
    }
    _run(fit, XDG_CACHE_HOME=str(folder / "cache"))  # the bytecode of an editable installation
    times = interleaved(contestants, 2 if quick else REPEATS, patience=np.inf)
    shutil.rmtree(folder, ignore_errors=True)
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
