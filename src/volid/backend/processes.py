"""Tasks in processes of this machine, one per core: the same numbers whatever the number of processes.

Processes are spawned, not forked, because JAX does not survive a fork. Each has one thread, because the number of threads of a
matrix product changes its last digits. The environment of the process that starts them changes only for the moment in which one
starts. A script that calls this needs `if __name__ == "__main__":`, because every process reads the script.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing, contextmanager, suppress
from multiprocessing.connection import wait as wait_for
from typing import Any

from volid.backend.counted import Counted
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


@contextmanager
def single_threaded_environment() -> Iterator[None]:
    """`os.environ` with `single_threaded()` within this context, and as it was before once all threads have left it.

    It acts on processes that are started within the context, and on NumPy and JAX when they are loaded within it.
    """
    with _SETTINGS.held():
        yield


def _set(undo: ExitStack) -> None:
    """Put `single_threaded()` into `os.environ`, and on `undo` how to take it out again."""
    for key, value in single_threaded().items():
        if key in os.environ:
            undo.callback(os.environ.__setitem__, key, os.environ[key])
        else:
            undo.callback(os.environ.pop, key, None)
        os.environ[key] = value


_SETTINGS = Counted(_set)


def in_processes(
    function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]], shared: Any, workers: int
) -> Iterator[tuple[int, Any]]:
    """(number, result) of function(shared, *task) for every task, as they finish, in `workers` processes.

    `function` stands at module level; `shared` is sent once to every process. When a process dies (out of memory, killed), its
    task is done again at the end, alone; when that fails too, the result is `Died`. Exceptions of `function` are raised. Raises
    `VolidError` when no process can be started.
    """
    suspects = []
    with closing(_results(function, tasks, range(len(tasks)), shared, workers, check=True)) as results:
        for i, result in results:
            if isinstance(result, Died):
                suspects.append(i)
            else:
                yield i, result
    yield from _results(function, tasks, suspects, shared, 1)


def _results(
    function: Callable[..., Any],
    tasks: Sequence[tuple[Any, ...]],
    numbers: Sequence[int],
    shared: Any,
    workers: int,
    check: bool = False,
) -> Generator[tuple[int, Any], None, None]:
    """(number, result) of the tasks with these numbers, `Died` for those whose process died; `check` that one starts."""
    before, waiting = set(multiprocessing.active_children()), deque(numbers)
    running: dict[Future[Any], tuple[int, _Process]] = {}

    def begin(process: _Process) -> None:
        number = waiting.popleft()
        running[process.submit(function, tasks[number])] = number, process

    processes: list[_Process] = []
    try:
        processes.extend(_Process(shared) for _ in range(min(workers, len(numbers))))
        if check and processes:
            processes[0].check()
        for process in processes:
            begin(process)
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                number, process = running.pop(future)
                try:
                    result = future.result()
                except BrokenProcessPool:
                    result = Died()
                yield number, result
                if waiting:
                    begin(process)
        for process in processes:
            process.end()
    except BaseException:
        for process in processes:
            process.end(wait=False)
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
        raise


class _Process:
    """One process, replaced when it dies and after `RENEW` tasks.

    Each process has a pool of its own, because a pool of several that breaks while it starts another process waits for that one
    forever.
    """

    def __init__(self, shared: Any) -> None:
        self._shared, self._tasks = shared, 0
        self._pool = self._new()

    def _new(self) -> ProcessPoolExecutor:
        pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)
        with single_threaded_environment():  # the process starts when it gets its first task
            # what is shared is that task, not an argument of the start: this would wait forever for a process that dies early
            self._ready = pool.submit(_keep, self._shared)
        return pool

    def check(self) -> None:
        """Raises `VolidError` when the process does not start."""
        try:
            self._ready.result()
        except BrokenProcessPool:
            raise VolidError(
                'worker processes do not start; in a script, call this under `if __name__ == "__main__":`, since every '
                "process reads the script; is there enough memory?"
            ) from None

    def submit(self, function: Callable[..., Any], task: tuple[Any, ...]) -> Future[Any]:
        """The future result of a task, when the one before is done."""
        self._tasks += 1
        if self._tasks <= RENEW:
            with suppress(BrokenProcessPool):
                return self._pool.submit(_call, function, task)
        self.end()
        self._pool, self._tasks = self._new(), 1
        try:
            return self._pool.submit(_call, function, task)
        except BrokenProcessPool as problem:  # died at once
            failed: Future[Any] = Future()
            failed.set_exception(problem)
            return failed

    def end(self, wait: bool = True) -> None:
        """No more tasks."""
        self._pool.shutdown(wait, cancel_futures=True)


def _begin() -> None:
    """What every process does first: it prepares to end at Ctrl-C without a message, and to end with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for([parent.sentinel])
        os._exit(1)


def _keep(shared: Any) -> None:
    global _SHARED
    _SHARED = shared


def _call(function: Callable[..., Any], task: tuple[Any, ...]) -> Any:
    return function(_SHARED, *task)
