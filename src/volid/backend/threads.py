"""One thread for BLAS: its products here are small, and more threads would compete with those of XLA and of volid.

On two cores a fit of 10 ms took up to 150 ms with two BLAS threads. When NumPy is loaded after this module, it starts with one
thread. When it was loaded before, it is limited to one thread during fits and Monte Carlo runs. A value of OPENBLAS_NUM_THREADS
that the user has set in the environment takes precedence.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import import_module
from threading import Lock
from typing import Any

NUMPY_CAME_FIRST = "numpy" in sys.modules and "OPENBLAS_NUM_THREADS" not in os.environ
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
_lock, _inside, _limit = Lock(), 0, ExitStack()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """BLAS has one thread within this context, and as many as before once every thread of the program has left it.

    It can also be used as a decorator.
    """
    global _inside
    if not NUMPY_CAME_FIRST:
        yield
        return
    with _lock:
        if not _inside:
            _keeper().submit(lambda: _limit.enter_context(_blas().limit(limits=1))).result()
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside:
                _keeper().submit(_limit.close).result()


@cache
def _keeper() -> Any:
    """The thread that sets and lifts the limit, because only the thread that set it may lift it."""
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(1, thread_name_prefix="volid-blas")


@cache
def _blas() -> Any:
    from threadpoolctl import ThreadpoolController

    import_module("scipy.linalg")  # brings a BLAS of its own
    return ThreadpoolController().select(user_api="blas")
