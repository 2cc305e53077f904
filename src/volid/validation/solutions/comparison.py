"""What changed between two solutions of one machine, tested for significance.

d = θ'_B - θ'_A,   covariance of what A and B do not share (`shared`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from volid.backend.threads import one_blas_thread
from volid.fitting.solution import Solution
from volid.model.error_functions import describe_datum
from volid.model.machine import Datum
from volid.plausibility.conditions import active_compensations, loads
from volid.validation.solutions.function_changes import LEVEL, Combination, FunctionChange, by_holm, function_change
from volid.validation.solutions.outputs import outputs_of
from volid.validation.solutions.shared import Said, Shared, what_is_shared
from volid.validation.solutions.states import in_one_model
from volid.validation.solutions.volume_change import VolumeChange, change_in, volume_of


@dataclass(frozen=True, eq=False)
class Comparison:
    """What changed from one solution to another.

    Args:
        names: What messages call the two.
        functions: Every function and constant, in the order of the model, as `FunctionChange`.
        volume: The change of the deviation field.
        datum: What functions refer to, in words.
        notes: What was assumed.
        attention: Why u may be too small.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> [f.name for f in volid.compare(solution, solution).functions]
    ['EXX', 'EZZ']
    """

    names: tuple[str, str]
    functions: tuple[FunctionChange, ...] = field(repr=False)
    volume: VolumeChange
    datum: str
    notes: tuple[str, ...]
    attention: tuple[str, ...]

    @property
    def significant(self) -> tuple[FunctionChange, ...]:
        """The functions that changed."""
        return tuple(f for f in self.functions if f.significant)

    @property
    def not_tested(self) -> tuple[str, ...]:
        """Functions of which the solutions tell nothing."""
        return tuple(f.name for f in self.functions if not f.degrees_of_freedom)


@one_blas_thread()
def compare(
    before: Solution,
    after: Solution,
    *,
    datum: Datum | None = None,
    common: Sequence[str] = (),
    independent: Sequence[str] = (),
    names: tuple[str, str] = ("A", "B"),
) -> Comparison:
    """What changed from one solution to another, with 5 % false alarms over all functions together.

    Per function one chi-square test over all that the readings determine of it, and Holm's rule over the functions
    (`volid.validation.solutions.function_changes`). The difference's u counts once what both share
    (`volid.validation.solutions.shared`): the machine's own smoothness, effects of the same instrument, an earlier solution that
    was a prior. Not modelled: an instrument that changed in between without saying so; how the machine scatters from one set-up
    to the next, beyond what the u of readings contain; short waves that no function follows.

    Args:
        before: The earlier solution.
        after: The later one, of the same machine with the same error functions.
        datum: The datum in which functions are compared; None: that of `before`.
        common: Names of systematic effects and artefacts that were the same ones in both campaigns, besides those that both
            name alike, with the same u and `per` = "campaign" or "tool".
        independent: Names of effects that were not the same ones although both campaigns name them alike.
        names: What messages call the two.

    Raises:
        InputError: other machines or error functions, ranges that hardly overlap, a common effect that one does not have.

    Source: ISO/TR 16907 4 b, 7.2, 8.6; Holm 1979; CONVENTIONS 4.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/published_positioning/campaign.toml")
    >>> solution = volid.fit(campaign)
    >>> found = compare(solution, solution)
    >>> found.significant, round(found.functions[0].largest_change, 9)
    ((), 0.0)
    """
    states = in_one_model((before, after), names, datum)
    shared = what_is_shared(states, Said(tuple(common), tuple(independent)))
    pair = Combination(shared, np.array([-1.0, 1.0]), np.array([0.0, 1.0]))
    return Comparison(
        names=names,
        functions=tested(pair),
        volume=change_in(volume_of(states), pair),
        datum=describe_datum(states.machine, states.model.datum),
        notes=(*states.notes, *shared.notes, *_other_loads(shared)),
        attention=doubts(shared),
    )


def tested(combination: Combination) -> tuple[FunctionChange, ...]:
    """Every function of the model, with Holm's rule over all of them."""
    outputs = outputs_of(combination.shared.of.model)
    found = [function_change(combination, o, LEVEL / max(len(outputs), 1)) for o in outputs]
    passed = by_holm(np.array([f.probability for f in found]))
    return tuple(replace(f, significant=bool(p)) for f, p in zip(found, passed, strict=True))


def doubts(shared: Shared) -> tuple[str, ...]:
    """Solutions whose own u is in doubt."""
    found = []
    for state in shared.of.states:
        if state.solution.adequacy.rejected:
            found.append(
                f"{state.name}: the model is rejected by its own data, so its u is too small and a change may be none: "
                f"{state.solution.adequacy.verdict}"
            )
        if not state.solution.statistics.converged:
            found.append(f"{state.name}: its fit has not converged")
    return (*found, *_other_compensations(shared))


def _other_compensations(shared: Shared) -> list[str]:
    """That campaigns state other active compensations, by their records of conditions."""
    stated = [active_compensations(s.solution.campaign.conditions) for s in shared.of.states]
    found = []
    for state, own in zip(shared.of.states[1:], stated[1:], strict=True):
        if set(own) != set(stated[0]):
            before, now = (", ".join(texts) or "none" for texts in (stated[0], own))
            found.append(
                f"{state.name} was measured with other compensations active ({now}) than {shared.of.states[0].name} ({before}): "
                "the change contains what they do"
            )
    return found


def _other_loads(shared: Shared) -> list[str]:
    """That campaigns state other loads: workpieces and tools bend a machine (ISO/TR 16907 8.6)."""
    before, now = (loads(s.solution.campaign.conditions) for s in shared.of.states)
    if not before or not now or set(before) == set(now):
        return []
    first, second = (s.name for s in shared.of.states)
    return [
        f"{second} was measured with another load ({', '.join(now)}) than {first} ({', '.join(before)}): the change contains "
        "what it does"
    ]
