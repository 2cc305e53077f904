"""What a long command is doing, on standard error: at once on a terminal, otherwise only when it takes more than a second."""

from __future__ import annotations

import sys
import threading
from types import TracebackType

from volid.cli.interrupts import INTERRUPTS

PATIENCE = 1.0  # s


class Progress:
    """Reports the current stage, `volid: locating stations`; silent while everything is quick.

    >>> with Progress() as progress:
    ...     progress("reading")
    """

    def __init__(self) -> None:
        self._current = ""
        self._awake = sys.stderr.isatty()
        self._lock = threading.Lock()
        self._timer = threading.Timer(PATIENCE, self._wake)
        self._timer.daemon = True

    def __enter__(self) -> Progress:
        self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()

    def __call__(self, stage: str) -> None:
        """The next stage begins. Raises KeyboardInterrupt when an interrupt has arrived and was dropped."""
        INTERRUPTS.check()
        with self._lock:
            self._current = stage
            if self._awake:
                self._print()

    def _wake(self) -> None:
        with self._lock:
            if not self._awake:
                self._awake = True
                self._print()

    def _print(self) -> None:
        if self._current:
            print(f"volid: {self._current}", file=sys.stderr, flush=True)
