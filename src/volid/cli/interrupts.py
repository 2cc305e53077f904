"""An interrupt (Ctrl-C) ends the program, even when it arrives where Python drops exceptions.

Python raises KeyboardInterrupt wherever the program happens to be. In a finaliser, or in a callback of the garbage collector
such as JAX's, an exception is printed and dropped, and the program would go on.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from types import FrameType, TracebackType

AGAIN = 0.01  # s


class Interrupts:
    """While entered, delivers an interrupt that Python dropped once more, soon after; `check`, called between stages, raises one
    that went missing in another way, as does leaving.

    Leaves signals alone where somebody else handles them, or outside the main thread.

    >>> with Interrupts() as interrupts:
    ...     interrupts.check()
    """

    def __init__(self) -> None:
        self._heard = False
        self._installed = False
        self._hook = sys.unraisablehook
        self._again = threading.Timer(AGAIN, _thread.interrupt_main)

    def __enter__(self) -> Interrupts:
        self._heard = False
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            try:
                signal.signal(signal.SIGINT, self._hear)
            except ValueError:  # not the main thread
                return self
            self._installed = True
            self._hook, sys.unraisablehook = sys.unraisablehook, self._dropped
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._installed:
            self._again.cancel()
            signal.signal(signal.SIGINT, signal.default_int_handler)
            sys.unraisablehook = self._hook
            self._installed = False
        if kind is None:
            self.check()
        self._heard = False

    def check(self) -> None:
        """Raises KeyboardInterrupt when an interrupt has arrived."""
        if self._heard:
            self._heard = False
            raise KeyboardInterrupt

    def _hear(self, number: int, frame: FrameType | None) -> None:
        self._heard = True
        raise KeyboardInterrupt

    def _dropped(self, unraisable: sys.UnraisableHookArgs) -> None:
        if unraisable.exc_type is KeyboardInterrupt:
            self._again = threading.Timer(AGAIN, _thread.interrupt_main)
            self._again.start()
        else:
            self._hook(unraisable)


INTERRUPTS = Interrupts()
"""Those of this process."""
