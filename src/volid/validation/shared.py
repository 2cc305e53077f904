"""Covariance of a combination Σ aᵢ θᵢ of solutions, with what they share counted once.

Every estimate is x = C Σ_s J_sᵀ l_s over sources s (`uncertainty.budget`), so its error is Σ_s C J_sᵀ ε_s. Sources that several
solutions share have one ε for all of them, and in a difference they cancel as far as both answer alike:

- an effect of the instrument, or an artefact, that was the same one each time: pseudo-reading ξ/u = 0 in every fit;
- the smoothness of the functions: pseudo-readings W θ = 0, whose ε = W θ of the machine itself. With K = Q⁻¹, Q the precision
  of the functions of a machine that has not changed, this part is D K Dᵀ with D = Σ aᵢ Sᵢ CᵢQᵢ; so two surveys at the same
  positions agree between
  the positions too, although neither knows what is there. K is that of both estimates of the smoothness together, with how
  uncertain these are. Where measured ranges differ it counts as independent;
- an earlier solution that was the prior of a later one: the readings of the first are part of the second. With R its
  pseudo-readings, cov(A, B) = A RᵀR B, and for B fitted after A alone the covariance of B - A becomes Σ_A - Σ_B.

Everything else is independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from volid.exceptions import InputError
from volid.fitting.datum import s_transformation
from volid.fitting.prior import prior_of
from volid.fitting.solution import Solution
from volid.validation.states import State, States

SAME_PRIOR = 1e-4  # relative difference of two sets of pseudo-readings up to which they are one
SMALLEST = 1e-7  # of the largest singular value of the pseudo-readings of the smoothness: below, a function is free
SAME_U = 1e-9  # relative difference of two u that are one


@dataclass(frozen=True, eq=False)
class Shared:
    """What solutions share. `effects`: per solution (n', e), errors caused by one standard deviation of every common effect."""

    of: States
    effects: tuple[np.ndarray, ...]
    notes: tuple[str, ...] = ()

    def covariance(self, weights: np.ndarray) -> np.ndarray:
        """Covariance of Σ aᵢ θ'ᵢ for `weights` a (k,), shape (n', n')."""
        states = self.of.states
        found = sum(a**2 * own for a, own in zip(weights, self._independent, strict=True))
        common = sum(a * e for a, e in zip(weights, self.effects, strict=True))
        found = found + common @ common.T
        if self.of.exact:
            spread = sum(a * s for a, s in zip(weights, self._by_smoothness, strict=True))
            found = found + spread @ spread.T
        for i in range(len(states)):
            for j in range(i + 1, len(states)):
                both = self._by_prior[i, j]
                if both is not None:
                    found = found + weights[i] * weights[j] * (both + both.T)
        return np.asarray(found)

    def total(self, weights: np.ndarray) -> np.ndarray:
        """Σ aᵢ² Cᵢ, as if nothing were shared, (n', n')."""
        return np.asarray(sum(a**2 * s.covariance for a, s in zip(weights, self.of.states, strict=True)))

    def smooth_part(self, weights: np.ndarray) -> np.ndarray:
        """What of `total` comes from the smoothness and from how uncertain that is itself, (n', n')."""
        return np.asarray(sum(a**2 * p @ p.T for a, p in zip(weights, self._smooth_errors, strict=True)))

    def response(self, i: int) -> np.ndarray:
        """Expected change of the estimate θ'ᵢ by a change of the machine's θ', shape (n', n'): less than all of it where the
        smoothness, or a prior from before the change, holds the estimate back."""
        state = self.of.states[i]
        n, back = state.solution.model.n_parameters, np.linalg.pinv(state.map)
        rows = state.solution.prior_rows
        return np.eye(len(state.map)) - state.reach[:, :n] @ (rows.T @ (rows @ back))

    @cached_property
    def _smooth_errors(self) -> list[np.ndarray]:
        """Per solution, f S C Wᵀ (1, G), (n', r + h): what pseudo-readings of the smoothness bring, whose covariance is 1 + G Gᵀ
        because the smoothness is uncertain."""
        found = []
        for state in self.of.states:
            n, factor = state.solution.model.n_parameters, state.solution.factor
            rows = state.reach[:, :n] @ state.solution.smooth_rows.T
            found.append(factor * np.hstack([rows, state.map @ state.solution.smooth_spread[:n]]))
        return found

    @cached_property
    def _independent(self) -> list[np.ndarray]:
        """Per solution, the covariance without what is shared."""
        found = []
        for state, effects, smooth in zip(self.of.states, self.effects, self._smooth_errors, strict=True):
            own = state.covariance - effects @ effects.T
            found.append(own - smooth @ smooth.T if self.of.exact else own)
        return found

    @cached_property
    def _by_smoothness(self) -> list[np.ndarray]:
        """Per solution, f S C Wᵀ W K^½ on the common θ', (n', r)."""
        states = self.of.states
        rows = [s.solution.smooth_rows @ np.linalg.pinv(s.map) for s in states]
        if not sum(map(len, rows)):
            return [np.zeros((self.of.model.n_parameters, 0))] * len(rows)
        root = _pinv(np.vstack(rows) / np.sqrt(len(rows)))
        noise = [w.solution.smooth.noise if w.solution.smooth else np.zeros((0, 0)) for w in states]
        uncertain = [_pinv(w) @ g / np.sqrt(len(rows)) for w, g in zip(rows, noise, strict=True)]
        machine = np.hstack([root, *uncertain])  # K^½: how one machine's θ' may lie
        return [e[:, : len(w)] @ (w @ machine) for e, w in zip(self._smooth_errors, rows, strict=True)]

    @cached_property
    def _by_prior(self) -> dict[tuple[int, int], np.ndarray | None]:
        """cov(θ'ᵢ, θ'ⱼ) by an earlier solution that both hold, by pair."""
        states = self.of.states
        pairs = [(i, j) for i in range(len(states)) for j in range(i + 1, len(states))]
        return {(i, j): _held_by_both(states[i], states[j]) for i, j in pairs}


def _pinv(rows: np.ndarray) -> np.ndarray:
    """Pseudo-inverse of pseudo-readings; functions that they leave free stay so."""
    return np.asarray(np.linalg.pinv(rows, rcond=SMALLEST)) if rows.size else np.zeros(rows.T.shape)


def what_is_shared(states: States, common: Sequence[str] = ()) -> Shared:
    """What solutions share, with the effects and artefacts that are said to be `common`, by name.

    Raises `InputError` for a name that not every solution has, or an effect common to a solution and to the one that was its
    prior.
    """
    effects = [_effect_errors(states, state, tuple(common)) for state in states.states]
    found = Shared(states, tuple(effects), _notes(states, tuple(common)))
    if common and any(both is not None for both in found._by_prior.values()):
        raise InputError(
            f"`common={common[0]}`: one solution is the prior of another, which has counted this as independent; fit all "
            "campaigns without a prior to compare them"
        )
    return found


def _name(entry) -> str:  # type: ignore[no-untyped-def]
    return str(entry.effect or entry.name)


def _known(solution: Solution) -> dict[object, tuple[int, str, float]]:
    """Number, name and u of every unknown that is known beforehand, by key."""
    return {
        e.key: (i, _name(e), e.prior_u)
        for i, e in enumerate(solution.nuisance_table)
        if np.isfinite(e.prior_u) and e.prior_u > 0.0
    }


def _effect_errors(states: States, state: State, common: tuple[str, ...]) -> np.ndarray:
    """(n', e): S C e_ξ / u of every unknown that has one of the common names and stands in all solutions."""
    everywhere = _everywhere(states)
    for name in common:
        if name not in {own[1] for own in everywhere.values()}:
            known = sorted({own[1] for own in everywhere.values()})
            raise InputError(
                f"`common={name}`: not every solution has an effect or artefact of this name with the same scope; those that "
                f"all have: {', '.join(known) or 'none'}"
            )
    own, n = _known(state.solution), state.solution.model.n_parameters
    chosen = [key for key, (_, name, _) in everywhere.items() if name in common]
    columns = [state.reach[:, n + own[key][0]] / own[key][2] for key in chosen]
    return np.stack(columns, axis=1) if columns else np.zeros((len(state.map), 0))


def _everywhere(states: States) -> dict[object, tuple[int, str, float]]:
    """The unknowns known beforehand that all solutions have with the same u, as the first has them."""
    first, *others = [_known(s.solution) for s in states.states]
    return {
        key: own
        for key, own in first.items()
        if all(key in o and abs(o[key][2] - own[2]) <= SAME_U * own[2] for o in others)
    }


def _notes(states: States, common: tuple[str, ...]) -> tuple[str, ...]:
    """Effects that might be common and were not said to be."""
    names = sorted({name for _, name, _ in _everywhere(states).values()} - set(common))
    if not names:
        return ()
    return (
        f"counted as independent each time, though all campaigns state them alike: {', '.join(names)}. Where it was the same "
        f"instrument or artefact, say so with `common={names[0]}`: then it does not hide a change",
    )


def _held_by_both(first: State, second: State) -> np.ndarray | None:
    """cov(θ'₁, θ'₂) where the second has the first as prior (or the first the second), or both the same one; else None.

    Raises `InputError` where both have priors, and these are not the same.
    """
    a, b = first.solution, second.solution
    if a.prior_root is None and b.prior_root is None:
        return None
    if b.prior_root is not None and _is_prior(a, b):
        return _by_rows(first, second, _on(a, b), np.asarray(b.prior_root), a.factor)
    if a.prior_root is not None and _is_prior(b, a):
        return _by_rows(second, first, _on(b, a), np.asarray(a.prior_root), b.factor).T
    if a.prior_root is None or b.prior_root is None:
        return None
    one, other = (np.asarray(s.prior_root) @ np.linalg.pinv(s_map) for s, s_map in ((a, first.map), (b, second.map)))
    if not _alike(one.T @ one, other.T @ other):
        raise InputError(
            f"{first.name} and {second.name} were fitted with different priors, and what these share is not known; fit the "
            "campaigns without a prior to compare them"
        )
    return _by_rows(first, second, np.asarray(a.prior_root), np.asarray(b.prior_root), 1.0)


def _by_rows(first: State, second: State, of_first: np.ndarray, of_second: np.ndarray, factor: float) -> np.ndarray:
    """f² S₁C₁ R₁ᵀ R₂ C₂S₂ᵀ."""
    if len(of_first) != len(of_second):  # the same information in another root
        of_second = of_first @ np.linalg.pinv(first.map) @ second.map
    one = first.reach[:, : of_first.shape[1]] @ of_first.T
    other = second.reach[:, : of_second.shape[1]] @ of_second.T
    return np.asarray(factor**2 * one @ other.T)


def _is_prior(earlier: Solution, later: Solution) -> bool:
    """Whether the pseudo-readings of `later` are those that `earlier` gives."""
    machine = later.campaign.machine
    try:
        now = later if later.datum == machine.datum else later.in_datum(machine.datum)
        before = earlier if earlier.datum == machine.datum else earlier.in_datum(machine.datum)
        expected = prior_of(before, now.model).root
    except InputError:
        return False
    own = np.asarray(now.prior_root)
    return _alike(own.T @ own, expected.T @ expected)


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.linalg.norm(one - other) <= SAME_PRIOR * max(np.linalg.norm(one), np.linalg.norm(other)))


def _on(earlier: Solution, later: Solution) -> np.ndarray:
    """The pseudo-readings of `later` as rows on θ of the solution that they came from."""
    if earlier.model.layout == later.model.layout and earlier.datum == later.datum:
        return np.asarray(later.prior_root)
    return np.asarray(np.asarray(later.prior_root) @ s_transformation(earlier.model, later.model, exact=False)[0])
