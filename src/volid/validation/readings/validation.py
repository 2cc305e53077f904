"""`validate`: a solution against readings that it was not made from (ISO/TR 16907 11.3)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from volid.backend.threads import one_blas_thread
from volid.campaign import Campaign
from volid.compensation.control import Control
from volid.exceptions import InputError
from volid.fitting.diagnosis.adequacy import Cause
from volid.fitting.solution import Solution
from volid.fitting.stages import breakdown_named
from volid.validation.readings.causes import causes
from volid.validation.readings.chi_squares import Smallest, Split, Test, smallest_changes, tests, together
from volid.validation.readings.equations import linear
from volid.validation.readings.groups import LEAST, Compared, Group, K, compared, groups
from volid.validation.readings.held_out import OPEN_END, REJECTED, HeldOut, held_out, with_factor
from volid.validation.readings.independence import SEEN, UNSTATED, active_notes, dependences, places_of, tools_in_common
from volid.validation.readings.shares import usual_share
from volid.validation.readings.verdict import NO_TEST, Outcome, far_smaller, untested, verdict_of, weak_points
from volid.validation.readings.whitened import Whitened

LEVEL = 0.95
UNFAIR = (SEEN, UNSTATED, REJECTED, OPEN_END, NO_TEST)  # how texts begin for which a confirmation means little


@dataclass(frozen=True, eq=False)
class Validation:
    """What readings of another campaign say of a solution.

    Args:
        confirmed: Whether they agree with its predictions, at probability `level` if it is right.
        verdict: That in words: whether, where not, and what the disagreement looks like; and that it was no test, where the fit
            has seen the readings.
        level: With which probability a right solution is confirmed.
        probability: Of a disagreement at least as large, if the solution is right.
        tests: The chi-squares that were asked.
        sets: Every reading with its prediction, residual, u and E_n.
        groups: Sets, stations, tools, ranges, regions, directions, those that fit worst first.
        causes: What explains a disagreement, best first.
        smallest: The smallest changes that would have been found with a probability of 90 %.
        weak: What this campaign cannot tell, or hardly, in words.
        dependences: What it has in common with the fit, in words; empty where it is another set-up.
        left_out: Rows outside the measured range, by set.
        usual_e_n_above_1: Shares of readings with E_n > 1 between which 95 % of right solutions lie; wide where what
            readings have in common moves many of them together.
        notes: What else should be known.

    >>> import volid
    >>> solution = volid.fit(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))
    >>> found = volid.validate(solution, volid.load_campaign("datasets/validation/after_knock.toml"))  # after a collision
    >>> found.confirmed, found.causes[0].what.split(" (")[0]
    (False, 'EC0Y')
    """

    confirmed: bool
    verdict: str
    level: float
    probability: float
    tests: tuple[Test, ...]
    sets: tuple[Compared, ...] = field(repr=False)
    groups: tuple[Group, ...] = field(repr=False)
    causes: tuple[Cause, ...]
    smallest: tuple[Smallest, ...]
    weak: tuple[str, ...]
    dependences: tuple[str, ...]
    left_out: dict[str, int]
    usual_e_n_above_1: tuple[float, float]
    notes: tuple[str, ...]

    @property
    def is_independent(self) -> bool:
        """Whether set-up and positions differ from the fit's."""
        return not self.dependences

    @property
    def attention(self) -> list[str]:
        """Why somebody should look: not confirmed, no test at all, or a solution that its own readings reject."""
        doubtful = [text for text in (*self.dependences, *self.weak, *self.notes) if text.startswith(UNFAIR)]
        return [*([] if self.confirmed else [self.verdict]), *doubtful]

    @property
    def e_n(self) -> np.ndarray:
        """E_n of every reading that has one, (n,)."""
        whole = np.concatenate([s.e_n.ravel() for s in self.sets])
        return np.asarray(whole[np.isfinite(whole)])

    @property
    def e_n_above_1(self) -> float:
        """Share of readings with E_n > 1; `usual_e_n_above_1` is to be expected, about 5 % on average."""
        return float(np.mean(self.e_n > 1.0)) if len(self.e_n) else float("nan")


@one_blas_thread()
@breakdown_named()
def validate(
    solution: Solution,
    campaign: Campaign,
    *,
    control: Control | None = None,
    level: float = LEVEL,
    extrapolate: bool = False,
) -> Validation:
    """Test a solution by the readings of another campaign.

    With r the readings less what the solution predicts, over u, and C = 1 + J Σ Jᵀ with Σ the covariance of the solution,

        χ² = min over b of (r - B b)ᵀ C⁻¹ (r - B b),

    where b are the campaign's own unknowns: stations, dead paths, offsets, alignments, spheres, and what the solution does not
    determine. The machine is held: it may differ from the solution as far as Σ allows and no further. χ² is split into
    independent parts (simple changes of the machine and its tools, smooth changes of its functions, the rest), so that a single
    wrong number is not lost among thousands of readings. Effects of the instrument that both campaigns name alike
    (`per` = "campaign" or "tool") are the same unknowns in both.

    E_n of a reading is |d| / (2 u(d)), with d = r - B b at the best b, and u(d) of reading and prediction together.

    Not tested: what the campaign cannot see (`Validation.smallest` says so), and the machine where it did not measure.

    Args:
        solution: The solution under test.
        campaign: Readings of the same machine that took no part in it.
        control: What compensated while the campaign was read, such as `volid.load_control` makes it of tables and grids; the
            prediction is then what the solution says remains. None: the machine as it was when it was fitted.
        level: Probability with which a right solution is confirmed.
        extrapolate: Predict readings beyond the measured range too; else they are left out and named.

    Raises:
        InputError: another machine, no readings, none within the measured range, or a level that is no probability.

    Source: ISO/TR 16907 11.3; ISO/IEC 17043 B.3.1.3 for E_n; Koch, Parameter Estimation and Hypothesis Testing, 4.2.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/published_positioning/campaign.toml")
    >>> found = volid.validate(volid.fit(campaign), campaign)  # against the readings that it was made from
    >>> found.is_independent
    False
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"`level={level}`; expected a probability between 0 and 1, such as 0.95")
    held = with_factor(held_out(solution, campaign, extrapolate))
    whitened = Whitened.of(linear(held.solution, held.campaign, control))
    if whitened.freedom < 1:
        raise InputError(
            f"{campaign.source or 'campaign'}: its {len(whitened.v)} readings are all taken up by its own stations, dead paths "
            "and offsets, so nothing is left to test; take more readings per set-up"
        )
    return _judged(held, Split.of(whitened), level, control)


def _judged(held: HeldOut, split: Split, level: float, control: Control | None) -> Validation:
    whitened, found = split.whitened, tests(split, level)
    sets = compared(whitened, held.rows)
    by_group = groups(whitened, sets)
    confirmed = all(t.passed for t in found)
    parameters = np.asarray(held.solution.parameters)
    why = () if confirmed else tuple(causes(whitened, split.changes, parameters, control))
    smallest = smallest_changes(split, level)
    nothing = untested(split, smallest, parameters, level)
    linear_ = whitened.linear
    own = places_of(linear_.problem.nuisance, linear_.z[linear_.problem.model.layout.n_coefficients :])
    common = dependences(held.solution, held.campaign, own)
    return Validation(
        confirmed,
        verdict_of(found, by_group, why, Outcome(level, any(t.startswith(SEEN) for t in common), nothing)),
        level,
        together(found),
        found,
        sets,
        by_group,
        why,
        smallest,
        (
            *filter(None, [nothing]),
            *weak_points(smallest),
            *filter(None, [tools_in_common(held.solution, held.campaign)]),
        ),
        common,
        held.left_out,
        usual_share(whitened, K, LEAST),
        (*held.notes, *filter(None, [far_smaller(split)]), *active_notes(held.solution, held.campaign, control)),
    )
