"""What a long command is doing, on standard error: at once on a terminal, otherwise only when it takes more than a second.

Counted steps show the remaining time. On a terminal one line is written over and over, at most once a second, and vanishes in the
end; elsewhere every stage has a line, and counted steps one every ten seconds.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from types import TracebackType

from volid.backend.steps import Step
from volid.cli.interrupts import INTERRUPTS
from volid.cli.remaining import Remaining, left_words
from volid.cli.streams import TransientLine

PATIENCE = 1.0  # s: before the first word where nobody watches, and between two words on a terminal
SPARSE = 10.0  # s: between two lines of counted steps where nobody watches


class Progress:
    """Reports the current stage, `volid: locating stations`; silent while everything is quick.

    Args:
        clock: The time [s], for tests.

    >>> with Progress() as progress:
    ...     progress("reading")
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._current, self._printed_at = "", -float("inf")
        self._remaining = Remaining()
        self._line = TransientLine.of(sys.stderr) if sys.stderr.isatty() else None
        self._awake = self._line is not None
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None

    def __enter__(self) -> Progress:
        self._again()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None
            if self._line is not None:
                self._line.clear()

    def __call__(self, stage: str) -> None:
        """The next stage begins. Raises KeyboardInterrupt when an interrupt has arrived and was dropped."""
        INTERRUPTS.check()
        with self._lock:
            is_new = not self._is_of_same_stage(stage)
            self._remaining.take(stage, self._clock())
            self._current = stage
            if self._awake and (is_new or self._is_due()):
                self._print()

    def tick(self) -> None:
        """What the timer does every second: the first word after a while, and the remaining time on a terminal."""
        with self._lock:
            is_first = not self._awake
            self._awake = True
            if self._current and (is_first or (self._line is not None and isinstance(self._current, Step))):
                self._print()

    def _is_of_same_stage(self, stage: str) -> bool:
        return isinstance(stage, Step) and stage.stage == self._remaining.stage

    def _is_due(self) -> bool:
        """Whether another step of the same stage is worth a word."""
        step = self._current
        is_last = isinstance(step, Step) and step.done >= step.total
        pause = SPARSE if self._line is None else PATIENCE
        return is_last or self._clock() - self._printed_at >= pause

    def _again(self) -> None:
        """Start the timer; on a terminal it starts itself again."""
        self._timer = threading.Timer(PATIENCE, self._ring)
        self._timer.daemon = True
        self._timer.start()

    def _ring(self) -> None:
        self.tick()
        with self._lock:
            if self._line is not None and self._timer is not None:
                self._again()

    def _print(self) -> None:
        if not self._current:
            return
        self._printed_at = self._clock()
        part = self._current.part if isinstance(self._current, Step) else ""
        left = left_words(self._remaining.seconds(self._printed_at), part)
        text = f"volid: {self._current}{', ' if left else ''}{left}"
        if self._line is not None:
            self._line.show(text)
        else:
            print(text, file=sys.stderr, flush=True)
