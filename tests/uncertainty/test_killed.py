"""Monte Carlo that is killed at random moments loses no finished batch, leaves no damaged file, and ends all the same."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from support.places import SOURCE
from support.small_campaign import fitted, make_campaign

from volid.io.solutions import read_solution, write_solution

pytestmark = pytest.mark.slow

TRIALS = 40_000
KILLS = 10


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("small")
    path = folder / "s.h5"
    write_solution(fitted(make_campaign(folder, n_per_station=30)), path)
    return path


def start(small: Path, out: Path) -> subprocess.Popen:
    command = ["uncertainty", str(small), "--trials", str(TRIALS), "--seed", "3", "--resume", "--json", "-o", str(out)]
    environment = os.environ | {"PYTHONPATH": str(SOURCE)}
    return subprocess.Popen(
        [sys.executable, "-m", "volid", *command], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def batches(folder: Path) -> dict[str, bytes]:
    """Every finished batch, read to its last number."""
    found = {}
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as file:
            found[path.name] = file["x"].tobytes()
    return found


def test_ten_kills(small, tmp_path):
    whole, out = tmp_path / "whole.h5", tmp_path / "out.h5"
    began = time.monotonic()
    assert start(small, whole).wait() == 0
    length, rng, kept, killed = time.monotonic() - began, np.random.default_rng(8), {}, 0
    folder = Path(f"{out}.trials")
    while killed < KILLS:
        process = start(small, out)
        try:
            process.wait(timeout=rng.uniform(0.0, length))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            killed += 1
        if out.exists():
            compare(out, whole)
            out.unlink()  # and all over again
            kept = {}
        now = batches(folder)
        assert kept.items() <= now.items(), "a finished batch is lost or changed"
        kept = now
    assert start(small, out).wait() == 0
    compare(out, whole)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.h5", "whole.h5"], "nothing else is left"


def compare(out: Path, whole: Path) -> None:
    first, second = (np.concatenate(list(read_solution(p).samples.batches())) for p in (whole, out))
    np.testing.assert_array_equal(first, second)
