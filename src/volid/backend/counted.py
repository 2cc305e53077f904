"""A setting of the process that several threads may ask for at once: the first makes it, the last takes it back."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from threading import Lock


class Counted:
    """A setting that holds while at least one thread is within `held`.

    Args:
        make: makes the setting, and puts on the stack it is given how to take the setting back.

    >>> log = []
    >>> setting = Counted(lambda undo: (log.append("made"), undo.callback(log.append, "taken back")))
    >>> with setting.held(), setting.held():
    ...     log.append("held")
    >>> log
    ['made', 'held', 'taken back']
    """

    def __init__(self, make: Callable[[ExitStack], object]) -> None:
        self._make, self._lock, self._inside, self._undo = make, Lock(), 0, ExitStack()

    @contextmanager
    def held(self) -> Iterator[None]:
        """The setting holds within this context, and is taken back once every thread has left it."""
        with self._lock:
            if not self._inside:
                self._make(self._undo)
            self._inside += 1
        try:
            yield
        finally:
            with self._lock:
                self._inside -= 1
                if not self._inside:
                    self._undo.close()
