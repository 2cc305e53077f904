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
from typing import Any

from volid.backend.counted import Counted

NUMPY_CAME_FIRST = "numpy" in sys.modules and "OPENBLAS_NUM_THREADS" not in os.environ
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """BLAS has one thread within this context, and as many as before once every thread of the program has left it.

    It can also be used as a decorator.
    """
    if not NUMPY_CAME_FIRST:
        yield
        return
    with _LIMIT.held():
        yield


def _limit(undo: ExitStack) -> None:
    """Limit BLAS to one thread, and put on `undo` how to lift the limit."""
    limit = _keeper().submit(lambda: _blas().limit(limits=1)).result()
    undo.callback(lambda: _keeper().submit(limit.restore_original_limits).result())


_LIMIT = Counted(_limit)


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
