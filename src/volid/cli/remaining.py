"""How long a stage of counted steps will still take, from the speed of the steps so far."""

from __future__ import annotations

from dataclasses import dataclass

from volid.backend.steps import Step

SHORTEST = 2.0  # s of work that an estimate needs
LEAST = 10.0  # s: what is said of anything shorter


@dataclass
class Remaining:
    """The remaining time of the stage that steps belong to.

    With the first step of a stage at time t0 and the last at t1, one unit of work takes (t1 - t0)/(d1 - d0), so that what came
    before the first step (compiling, work that was resumed) does not count. Between two steps the time goes on, but not below
    what would remain if the next step were done now: a step that takes longer is not promised to end.

    >>> left = Remaining()
    >>> for done, now in ((10, 100.0), (20, 110.0), (40, 130.0)):
    ...     left.take(Step(done, 100, "trials"), now)
    >>> left.seconds(130.0), left.seconds(140.0), left.seconds(300.0)
    (60.0, 50.0, 40.0)
    """

    stage: str = ""
    first: tuple[float, float] = (0.0, 0.0)
    last: tuple[float, float] = (0.0, 0.0)
    chunk: float = 0.0
    total: float = 0.0
    even: bool = True

    def take(self, message: str, now: float) -> None:
        """A message at time `now` [s]: another step, or, if it counts nothing or something else, another stage."""
        if not isinstance(message, Step) or message.done < self.last[0]:
            self.stage = ""
        if isinstance(message, Step):
            if message.stage != self.stage:
                self.stage, self.first, self.chunk = message.stage, (message.done, now), 0.0
            else:
                self.chunk = message.done - self.last[0]
            self.last, self.total, self.even = (message.done, now), message.total, message.even

    def seconds(self, now: float) -> float | None:
        """The remaining time of the stage [s]; None where the steps do not tell it yet."""
        (start, began), (done, latest) = self.first, self.last
        if not self.stage or not self.even or done <= start or latest - began < SHORTEST:
            return None
        each = (latest - began) / (done - start)
        return max((self.total - done) * each - min(now - latest, self.chunk * each), 0.0)


def left_words(seconds: float | None, part: str = "") -> str:
    """The remaining time as people say it: no more digits than an estimate has; "" where it is not known.

    Args:
        seconds: The time [s].
        part: What ends then, where it is not the work: "this pass".

    >>> left_words(4.0), left_words(37.0), left_words(200.0), left_words(9000.0, "this pass"), left_words(None)
    ('less than 10 s left', 'about 40 s left', 'about 3 min left', 'about 2.5 h left of this pass', '')
    """
    if seconds is None:
        return ""
    return f"{_time_words(seconds)} left{' of ' if part else ''}{part}"


def _time_words(seconds: float) -> str:
    if seconds < LEAST:
        return f"less than {LEAST:.0f} s"
    if seconds < 95.0:
        return f"about {10 * round(seconds / 10)} s"
    if seconds < 5700.0:
        return f"about {round(seconds / 60)} min"
    return f"about {0.5 * round(seconds / 1800):g} h"
