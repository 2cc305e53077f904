"""How much work something is, counted and not timed: machines differ, and are busy."""

import sys


def calls(function) -> int:
    """Number of calls, of Python and of C functions, that `function` makes on its thread: loops over rows make many."""
    count = 0

    def note(frame, event, argument):
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(note)
    try:
        function()
    finally:
        sys.setprofile(None)
    return count
