"""Messages of long work that say how far it is: texts for people, with the numbers from which the remaining time follows."""

from __future__ import annotations


class Step(str):
    """A message such as "250 of 1000 trials (25 %)", which knows its numbers.

    Functions that take messages about the progress need not know of it: it is a text.

    Args:
        done: How much is done, in the same unit as `total`.
        total: How much there is to do.
        what: What is counted; another `what` is another stage, with a speed of its own.
        of: The pass that counts, where several follow each other and nobody knows how many.
        more: What else to say, behind the numbers.

    >>> step = Step(250, 1000, "trials")
    >>> str(step), step.done, step.total
    ('250 of 1000 trials (25 %)', 250, 1000)
    >>> print(Step(12_000, 40_000, "rows", of="solving"))
    solving: 12000 of 40000 rows (30 %)
    """

    done: float
    total: float
    stage: str
    even: bool  # whether the steps take equal times, so that the remaining time follows
    part: str  # what the end of these steps ends, such as "this pass"; "" for the work

    def __new__(cls, done: int, total: int, what: str, *, of: str = "", more: str = "") -> Step:
        share = 100 * done // max(total, 1)
        text = f"{done} of {total} {what} ({share} %){more}"
        step = super().__new__(cls, f"{of}: {text}" if of else text)
        step.done, step.total, step.stage, step.part = done, total, f"{of} {what}", "this pass" if of else ""
        step.even = True
        return step

    @classmethod
    def number(cls, k: int, total: int, what: str) -> Step:
        """The k-th of `total` things begins, which take unequal times: no remaining time follows.

        >>> print(Step.number(5, 13, "drawing, section"))
        drawing, section 5 of 13
        """
        step = str.__new__(cls, f"{what} {k} of {total}")
        step.done, step.total, step.stage, step.part, step.even = k, total, what, "", False
        return step

    def within(self, part: str) -> Step:
        """The same message, whose end is that of a `part` of the work."""
        self.part = part
        return self
