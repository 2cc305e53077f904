"""Tasks in processes of this machine, one per core: the same numbers whatever the number of processes.

Processes are spawned, not forked (JAX does not survive a fork), with one thread each: the number of threads of a matrix
product changes its last digits. A script that calls this needs `if __name__ == "__main__":`, because every process reads it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait as wait_for
from typing import Any

from volid.exceptions import VolidError

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "NPROC": "1"}
XLA_FLAG = "--xla_cpu_multi_thread_eigen=false"
RENEW = 64  # tasks of a process before it is replaced: compiled programs of ever new shapes would fill the memory
_SHARED: Any = None  # of this process


class Died:
    """Result of a task whose process died twice, the second time alone."""


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def single_threaded() -> dict[str, str]:
    """Settings of the environment that make NumPy and JAX use one thread and the CPU; an explicit platform wins."""
    flags = os.environ.get("XLA_FLAGS", "")
    flags = flags if XLA_FLAG in flags else f"{flags} {XLA_FLAG}".strip()
    return ONE_THREAD | {"XLA_FLAGS": flags, "JAX_PLATFORMS": os.environ.get("JAX_PLATFORMS") or "cpu"}


def in_processes(
    function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]], shared: Any, workers: int
) -> Iterator[tuple[int, Any]]:
    """(number, result) of function(shared, *task) for every task, as they finish, in `workers` processes.

    `function`: at module level; `shared`: sent once to every process. Tasks of a process that dies (out of memory, killed) are
    done again, alone; `Died` is the result when that fails too. Exceptions of `function` are raised. Raises `VolidError` when
    no process can be started.
    """
    waiting = list(range(len(tasks)))
    while waiting:
        part, waiting = waiting[: RENEW * workers], waiting[RENEW * workers :]
        suspects, untouched = yield from _pool(function, tasks, part, shared, workers)
        for i in suspects:
            again, _ = yield from _pool(function, tasks, [i], shared, 1)
            if again:
                yield i, Died()
        if len(untouched) == len(part):
            raise VolidError("worker processes die before they do anything; is there enough memory?")
        waiting = untouched + waiting


def _pool(
    function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]], part: list[int], shared: Any, workers: int
) -> Generator[tuple[int, Any], None, tuple[list[int], list[int]]]:
    """Results of a part of the tasks; returns those that were in work when a process died, and those not begun."""
    before, left, running = set(multiprocessing.active_children()), list(part), dict[Future[Any], int]()
    workers = min(workers, len(part))
    context = multiprocessing.get_context("spawn")
    with _environment(single_threaded()):
        pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=(shared,))
        try:
            _start(pool)
            while left or running:
                while left and len(running) < workers:
                    running[pool.submit(_call, function, tasks[left[0]])] = left[0]
                    left.pop(0)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    yield running.pop(future), result
            pool.shutdown()
        except BrokenProcessPool:
            pool.shutdown(cancel_futures=True)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - before:
                child.terminate()
            raise
    return list(running.values()), left


def _start(pool: ProcessPoolExecutor) -> None:
    try:
        pool.submit(_ready).result()
    except BrokenProcessPool:
        raise VolidError(
            'worker processes do not start; in a script, call this under `if __name__ == "__main__":`, since every process '
            "reads the script"
        ) from None


@contextmanager
def _environment(settings: dict[str, str]) -> Iterator[None]:
    """`os.environ` with `settings`, for processes that are started meanwhile."""
    old = {key: os.environ.get(key) for key in settings}
    os.environ.update(settings)
    try:
        yield
    finally:
        for key, value in old.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value


def _begin(shared: Any) -> None:
    """First in every process: keep `shared`, end at Ctrl-C without words, and end with the parent."""
    global _SHARED
    _SHARED = shared
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for([parent.sentinel])
        os._exit(1)


def _ready() -> None:
    pass


def _call(function: Callable[..., Any], task: tuple[Any, ...]) -> Any:
    return function(_SHARED, *task)
