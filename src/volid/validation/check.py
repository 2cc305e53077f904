"""The quick check: do few new readings still agree with an old solution, and if not, what has changed? ISO/TR 16907 4 b.

The readings are tested against their prediction as in `validate`: with the covariance of the solution, their own unknowns
projected out, |v|² is chi-square distributed while nothing has changed. Half of the 5 % of false alarms belongs to this test of
everything, half to the best of the suspects (`suspects`), since |v|² of forty readings hardly notices one number. With Q a
basis of what a suspect does to v,

    drop of chi-square g = |Qᵀ v|²,   k degrees of freedom,

and suspects compete by g - k log n (Schwarz 1978). Those within `search.RIVAL` of the best are named beside it: the readings do
not tell them apart. What is found is released, and the others are asked again about what is left.

The updated solution is the fit of the new readings with the old solution as prior knowledge, of which the combinations that
changed are taken out: all contrasts that do not depend on them keep their covariance. With them in, the old value would hold
the new one back. Where rivals explain the readings nearly as well, the fit is made with each of them released instead, and
what it differs by is added to the covariance, w d dᵀ with its odds w against the best (Schwarz): u holds whichever it was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from volid.backend.threads import one_blas_thread
from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.fitting.results import read_only
from volid.fitting.solution import Solution
from volid.fitting.stages import breakdown_named
from volid.validation.readings.equations import linear
from volid.validation.readings.held_out import held_out, with_factor
from volid.validation.readings.independence import active_notes
from volid.validation.readings.whitened import Whitened
from volid.validation.search import LEVEL, Picked, Search
from volid.validation.suspects import VISIBLE, Suspect, suspects_of


@dataclass(frozen=True, eq=False)
class Finding:
    """A suspect that explains the disagreement.

    `size` with `u` in `unit`: of a constant its change, of an error motion the largest, at position `at`; NaN of what is
    not the machine with several numbers. `probability`: of a drop of chi-square as large by chance, all suspects that were
    tried counted. `is_machine`: False for a tool or an instrument. `rivals`: names of suspects that explain it nearly as
    well.
    """

    name: str
    words: str
    size: float
    u: float
    unit: str
    at: float
    probability: float
    is_machine: bool
    rivals: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Check:
    """What new readings say of an old solution.

    Args:
        changed: Whether they disagree (5 % false alarms).
        chi_square: Of all readings against their prediction.
        degrees_of_freedom: Of `chi_square`.
        probability: Of a `chi_square` at least as large where nothing has changed.
        findings: What changed, the surest first, as `Finding`; empty where nothing that was tried explains it.
        rest: Probability of what the findings leave.
        smallest_found: By name of constants and scales, the size of a change that nine of ten such checks find [mm, rad; of a
            scale mm over its range]; inf: none.
        updated: The solution of the new readings with the old one as prior, what changed released.
        left_out: Rows outside the measured range, by set.
        notes: What else should be known.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/published_positioning/campaign.toml")
    >>> volid.quick_check(volid.fit(campaign), campaign).left_out
    {}
    """

    changed: bool
    chi_square: float
    degrees_of_freedom: int
    probability: float
    findings: tuple[Finding, ...]
    rest: float
    smallest_found: dict[str, float]
    updated: Solution = field(repr=False)
    left_out: dict[str, int]
    notes: tuple[str, ...]


@one_blas_thread()
@breakdown_named()
def check(solution: Solution, campaign: Campaign, *, progress: Callable[[str], None] | None = None) -> Check:
    """Test an old solution by few new readings, name what has changed, and update it.

    Effects of the instrument that both campaigns name alike (`per` = "campaign" or "tool") are the same unknowns in both. Not
    modelled: changes that no suspect describes, such as one that is local to a tenth of a travel; several changes at once that
    look like one.

    Args:
        solution: The old solution.
        campaign: New readings on the same machine: forty distances, one circle of a ball bar, four diagonals.
        progress: Called with a message at every stage.

    Raises:
        InputError: another machine, no readings within the measured range, or all of them taken up by their own unknowns.

    Source: ISO/TR 16907 4 b, 11.3; Schwarz, Ann. Statist. 6 (1978) 461.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/published_positioning/campaign.toml")
    >>> found = check(volid.fit(campaign), campaign)
    >>> found.changed, found.findings
    (False, ())
    """
    say = progress or (lambda _: None)
    say("comparing with the prediction")
    held = with_factor(held_out(solution, campaign))
    whitened = Whitened.of(linear(held.solution, held.campaign))
    if whitened.freedom < 1:
        raise InputError(
            f"{campaign.source or 'campaign'}: its {len(whitened.v)} readings are all taken up by its own stations, dead paths "
            "and offsets, so nothing is left to check; take more readings per set-up"
        )
    suspects = suspects_of(whitened)
    search = Search(whitened, tuple(suspects))
    chi_square = float(whitened.v @ whitened.v)
    probability = float(chdtrc(whitened.freedom, chi_square))
    picked = search.picked(everything=probability)
    changed = probability <= 0.5 * LEVEL or bool(picked)
    say("updating the solution")
    released, others = _released(picked)
    return Check(
        changed=changed,
        chi_square=chi_square,
        degrees_of_freedom=whitened.freedom,
        probability=probability,
        findings=tuple(_finding(search, p, picked) for p in picked),
        rest=search.rest(picked),
        smallest_found=search.smallest(),
        updated=_with_rivals(
            updated(solution, campaign, released), [(updated(solution, campaign, o.released), o.odds) for o in others]
        ),
        left_out=held.left_out,
        notes=(*held.notes, *active_notes(solution, campaign, None)),
    )


def updated(solution: Solution, campaign: Campaign, released: Sequence[Suspect]) -> Solution:
    """The fit of new readings with an old solution as prior, without what it says of the released suspects."""
    steps = [s.steps for s in released if s.steps is not None]
    if not steps:
        return fit(campaign, prior=solution)
    null = np.hstack([np.asarray(solution.null_space), *steps])
    found = fit(campaign, prior=replace(solution, null_space=read_only(null)))
    names = ", ".join(s.name for s in released)
    note = f"from an earlier solution, of which {names} was released because new readings contradict it"
    return replace(found, notes=(*found.notes, note))


class _Other(NamedTuple):
    """What would be released with a rival in place of a finding, and the odds of that, at most 1."""

    released: list[Suspect]
    odds: float


def _released(picked: Sequence[Picked]) -> tuple[list[Suspect], list[_Other]]:
    """What of the machine is released, and what would be with a rival in place of each finding."""
    found, others = [p.suspect for p in picked if p.suspect.is_machine], []
    for p in picked:
        rest = [s for s in found if s is not p.suspect]
        others += [_Other([*rest, r], odds) for r, odds in zip(p.near, p.odds, strict=True) if r.is_machine]
        elsewhere = [odds for r, odds in zip(p.near, p.odds, strict=True) if not r.is_machine]
        if p.suspect.is_machine and elsewhere:
            others.append(_Other(rest, max(elsewhere)))
    return found, others


def _with_rivals(found: Solution, others: Sequence[tuple[Solution, float]]) -> Solution:
    """A solution whose covariance holds what others of the same readings differ from it by, with their odds."""
    alike = [(o, odds) for o, odds in others if o.covariance.shape == found.covariance.shape]
    if not alike:
        return found
    own = np.concatenate([np.asarray(found.parameters), np.asarray(found.nuisance)])
    away = [np.sqrt(w) * (np.concatenate([np.asarray(o.parameters), np.asarray(o.nuisance)]) - own) for o, w in alike]
    note = "its u holds that the new readings do not tell what was released from its rivals"
    covariance = np.asarray(found.covariance) + np.transpose(away) @ np.array(away)
    return replace(found, covariance=read_only(covariance), notes=(*found.notes, note))


def _finding(search: Search, own: Picked, picked: Sequence[Picked]) -> Finding:
    """Size and u of one of several changes that are estimated together."""
    whitened = search.whitened
    columns = np.hstack([p.suspect.columns for p in picked])
    vectors, sizes, vt = np.linalg.svd(whitened.free(columns), full_matrices=False)
    kept = sizes >= VISIBLE
    turn = vt[kept].T / sizes[kept]
    values, covariance = turn @ (vectors[:, kept].T @ whitened.v), turn @ turn.T
    first = sum(p.suspect.columns.shape[1] for p in picked[: list(picked).index(own)])
    part = slice(first, first + own.suspect.columns.shape[1])
    suspect = own.suspect
    size, u, at = suspect.size(values[part], covariance[part, part])
    return Finding(
        suspect.name,
        suspect.words,
        size,
        u,
        suspect.unit,
        at,
        own.probability,
        suspect.is_machine,
        own.rivals,
    )
