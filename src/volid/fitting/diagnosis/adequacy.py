"""Adequacy of the model: what the residuals say of it, as a record that every solution holds.

When the model is wrong (cross effects, drift, outliers, a pitch, instruments worse than stated), the residuals show it. `tally`
tests them, `verdict` grades what the tests find. ISO/TR 16907 11.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from volid.campaign import ObservationSet
from volid.fitting.mixed.records import SetTest
from volid.observations import KINDS

ACCEPTED, ENLARGED, REJECTED, NOT_TESTABLE = "accepted", "accepted, u enlarged", "rejected", "not testable"
QUESTIONED = "questioned"
GRADES = (ACCEPTED, ENLARGED, REJECTED, NOT_TESTABLE, QUESTIONED)
HOPELESS = 50.0  # unit weight from which on a rejected fit says nothing about the machine


@dataclass(frozen=True)
class GroupTest:
    """Chi-square of one group of readings: `what` ("station S1"), readings, unit weight, probability if the model holds.

    `sort`: what the group has in common with others ("set", "linear", "region", a label such as "station"); empty where a
    file of an earlier version does not say it.
    """

    what: str
    n: int
    unit_weight: float
    probability: float
    sort: str = ""


@dataclass(frozen=True)
class SuspectReading:
    """A reading whose normalised residual exceeds the critical value: where, residual in its `unit`, normalised."""

    where: str
    label: str
    residual: float
    normalised: float
    unit: str = "mm"


@dataclass(frozen=True)
class Cause:
    """What explains a misfit, from a test of an alternative: its sort, such as "drift of a station", and itself in words.

    `cure`: what to write into which file, or what to do. `drop`: fall of chi-square; `gain`: of -2 log likelihood, beyond what a
    larger u explains; `unknowns`: how many it takes; `log10_probability` of such a gain by chance, all places that were tried
    counted. `change`: by how much the result changes where it changes most, over its U (k = 2); infinite where all of it does.
    """

    cause: str
    what: str
    cure: str
    drop: float
    gain: float
    unknowns: int
    log10_probability: float
    change: float


@dataclass(frozen=True)
class Question:
    """What cannot be told from the readings, and has to be asked: `text`, with what to do. `about_values`: the numbers of the
    solution may be wrong as a whole, so that no table is made of them before it is answered; otherwise only their u."""

    text: str
    about_values: bool


@dataclass(frozen=True)
class Adequacy:
    """Verdict on a fit.

    `chi_square`, `degrees_of_freedom`, `unit_weight` = sqrt(chi²/dof) (NaN without redundancy); `probability` of a chi-square
    at least this large if the model holds. `groups`: all group tests, least probable first. `suspects`: readings beyond
    the critical value. `rejected`: the model, with the stated uncertainties, is rejected by the data. `grade`: one of `GRADES`.
    `factor`: what every u of the solution is multiplied by, 1 for none. `causes`: what explains the misfit, best first.
    `questions`: what the readings cannot tell, and is asked. `sets`: what is found of each set among the others.
    `redundancy`: how many readings check others, what is known beforehand (smoothness, calibrations) not counted, and
    `reading_weight`: their unit weight without it; NaN in solutions of earlier versions.
    """

    chi_square: float
    degrees_of_freedom: int
    unit_weight: float
    probability: float
    groups: tuple[GroupTest, ...]
    suspects: tuple[SuspectReading, ...]
    rejected: bool
    verdict: str
    grade: str = ""
    factor: float = 1.0
    causes: tuple[Cause, ...] = ()
    questions: tuple[Question, ...] = ()
    sets: tuple[SetTest, ...] = ()
    redundancy: float = math.nan
    reading_weight: float = math.nan

    @property
    def barrier(self) -> str:
        """Why no numbers of the solution are worth looking at, in one sentence; empty where they are.

        A fit whose residuals are fifty times their u follows a mistake, not the machine; and where a question about the values
        themselves is open, the answer decides about all of them.
        """
        if self.rejected and (self.unit_weight > HOPELESS or any(np.isinf(c.change) for c in self.causes)):
            likely = f"; likely cause: {self.causes[0].what}" if self.causes else ""
            return f"the model is rejected by the data with unit weight {self.unit_weight:.3g}{likely}"
        asked = [q.text for q in self.questions if q.about_values]
        return asked[0] if asked else ""

    def __post_init__(self) -> None:
        if not self.grade:  # files of earlier versions do not state it
            tested = REJECTED if self.rejected else ACCEPTED
            object.__setattr__(self, "grade", tested if self.degrees_of_freedom > 0 else NOT_TESTABLE)


def reading_label(observations: ObservationSet, i: int, k: int) -> str:
    """What a reading belongs to, in words; where a row's readings have different units, with the name of reading `k`."""
    kind = KINDS[observations.kind]
    texts = [f"{label} {observations.labels[label][i]}" for label in kind.named_by]
    return ", ".join([*texts, *(kind.readings[k : k + 1] if kind.units else ())])


def suspect(observations: ObservationSet, i: int, k: int, whitened: float, normalised: float) -> SuspectReading:
    """Reading `k` of row `i` with its whitened residual, named."""
    return SuspectReading(
        observations.where(i),
        reading_label(observations, i, k),
        whitened * float(observations.u[i, k]),
        normalised,
        KINDS[observations.kind].unit_at(observations, i, k),
    )
