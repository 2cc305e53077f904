"""BLAS has one thread while volid computes, whoever loaded NumPy first, and as many as before afterwards."""

import json
import os
import subprocess
import sys

import pytest
from support.places import BUNDLED as CAMPAIGN
from support.places import SOURCE

COUNT = """
import json
from threadpoolctl import threadpool_info
def threads():
    return max(lib["num_threads"] for lib in threadpool_info() if lib["user_api"] == "blas")
"""
NUMPY_FIRST = f"import numpy, scipy.linalg\n{COUNT}\nseen = [threads()]\n"
FIT = f"""
import volid
from volid.fitting.equations import solver
factorise = solver._factorise
def counting(*arguments):
    seen.append(threads())
    return factorise(*arguments)
solver._factorise = counting
volid.fit(volid.load_campaign({str(CAMPAIGN)!r}))
"""


def counted(script: str, **environment: str) -> list[int]:
    clean = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    run = subprocess.run(
        [sys.executable, "-c", f"{script}\nprint(json.dumps(seen))"],
        capture_output=True, text=True, check=True, env=clean | {"PYTHONPATH": str(SOURCE)} | environment,
    )  # fmt: skip
    return json.loads(run.stdout)


@pytest.fixture(autouse=True)
def limits_of_others(monkeypatch):
    """What a job scheduler or Dask puts into an environment: OpenBLAS reads OMP_NUM_THREADS, too."""
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.setenv(name, "1")


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core, one thread")
def test_numpy_loaded_before_has_one_thread_within_a_fit_and_all_afterwards():
    before, *within, after = counted(f"{NUMPY_FIRST}{FIT}seen.append(threads())")
    assert before == after > 1
    assert len(within) > 2 and set(within) == {1}


def test_numpy_loaded_afterwards_begins_with_one_thread():
    assert counted(f"import volid\n{NUMPY_FIRST}") == [1]


def test_an_explicit_setting_wins():
    assert set(counted(f"{NUMPY_FIRST}{FIT}", OPENBLAS_NUM_THREADS="2")) == {2}


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core, one thread")
def test_all_threads_come_back_when_the_last_one_leaves():
    script = """
import volid, threading
from volid.backend.threads import one_blas_thread
entered, leave = threading.Event(), threading.Event()
def other():
    with one_blas_thread():
        entered.set()
        leave.wait()
thread = threading.Thread(target=other)
with one_blas_thread():
    thread.start()
    entered.wait()
    seen.append(threads())
seen.append(threads())
leave.set()
thread.join()
seen.append(threads())
with one_blas_thread(), one_blas_thread():
    seen.append(threads())
seen.append(threads())
"""
    before, *counts = counted(NUMPY_FIRST + script)
    assert counts == [1, 1, before, 1, before]
