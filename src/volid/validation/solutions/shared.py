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
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from volid.exceptions import InputError
from volid.fitting.datum import s_transformation
from volid.fitting.prior import prior_of
from volid.fitting.solution import Solution
from volid.validation.readings.equations import shared_effects
from volid.validation.solutions.states import State, States

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
                both = self.by_prior[i, j]
                if both is not None:
                    found = found + weights[i] * weights[j] * (both + both.T)
        return np.asarray(found)

    def total(self, weights: np.ndarray) -> np.ndarray:
        """Σ aᵢ² Cᵢ, as if nothing were shared, (n', n')."""
        return np.asarray(sum(a**2 * s.covariance for a, s in zip(weights, self.of.states, strict=True)))

    def smooth_errors(self, weights: np.ndarray, name: str) -> np.ndarray:
        """What of `total` comes from the smoothness of one function, and from how uncertain that is: a root, (n', r)."""
        found = [np.zeros((self.of.model.n_parameters, 0))]
        for a, state in zip(weights, self.of.states, strict=True):
            solution, n = state.solution, state.solution.model.n_parameters
            own = np.zeros(n, dtype=bool)
            for f in solution.model.functions:
                own[f.parameters] |= f.name == name
            rows = np.any(solution.smooth_rows[:, own] != 0.0, axis=1)
            errors = a * solution.factor * state.reach[:, :n] @ solution.smooth_rows[rows].T
            found += [errors] if solution.smooth is None else [errors, errors @ solution.smooth.noise[rows]]
        return np.hstack(found)

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
    def by_prior(self) -> dict[tuple[int, int], np.ndarray | None]:
        """cov(θ'ᵢ, θ'ⱼ) by an earlier solution that both hold, by pair."""
        states = self.of.states
        pairs = [(i, j) for i in range(len(states)) for j in range(i + 1, len(states))]
        return {(i, j): _held_by_both(states[i], states[j]) for i, j in pairs}


def _pinv(rows: np.ndarray) -> np.ndarray:
    """Pseudo-inverse of pseudo-readings; functions that they leave free stay so."""
    return np.asarray(np.linalg.pinv(rows, rcond=SMALLEST)) if rows.size else np.zeros(rows.T.shape)


class Said(NamedTuple):
    """What is said of effects and artefacts by name: `common`, one and the same each time; `independent`, not so."""

    common: tuple[str, ...] = ()
    independent: tuple[str, ...] = ()


def what_is_shared(states: States, said: Said) -> Shared:
    """What solutions share.

    Effects that all campaigns name alike, with the same u and `per` = "campaign" or "tool", are one and the same each time, as in
    a fit of all campaigns together, unless they are said to be independent; others where they are said to be common.

    Raises `InputError` for a name that not every solution has, or an effect said to be common to a solution and to the one that
    was its prior.
    """
    everywhere = _everywhere(states)
    for what, names in zip(Said._fields, said, strict=True):
        _check_names(what, names, everywhere)
    alike = {name for key, (_, name, _) in everywhere.items() if key in _recognised(states)} - set(said.independent)
    chosen = alike | set(said.common)
    effects = tuple(
        _effect_errors(state, [k for k, own in everywhere.items() if own[1] in chosen]) for state in states.states
    )
    found = Shared(states, effects, _notes(everywhere, alike, chosen | set(said.independent)))
    found = replace(found, notes=(*found.notes, *_unknown_priors(found)))
    if not chosen or all(both is None for both in found.by_prior.values()):
        return found
    if said.common:
        raise InputError(
            f"`common={said.common[0]}`: one solution is the prior of another, which has counted this as independent; fit all "
            "campaigns without a prior to compare them"
        )
    note = f"counted as independent, as the fit with a prior has done: {', '.join(sorted(alike))}"
    return Shared(states, tuple(np.zeros((len(s.map), 0)) for s in states.states), (*_unknown_priors(found), note))


def _check_names(what: str, names: tuple[str, ...], everywhere: dict[object, tuple[int, str, float]]) -> None:
    known = sorted({own[1] for own in everywhere.values()})
    for name in names:
        if name not in known:
            raise InputError(
                f"`{what}={name}`: not every solution has an effect or artefact of this name with the same u and scope; those "
                f"that all have: {', '.join(known) or 'none'}"
            )


def _recognised(states: States) -> set[object]:
    """Keys of effects that all solutions have for the same reason that two campaigns fitted together have them in common."""
    first, *others = [s.solution for s in states.states]
    found: list[set[object]] = [
        {first.nuisance_table[i].key for i in shared_effects(o, first.nuisance_table)} for o in others
    ]
    return found[0].intersection(*found[1:])


def _name(entry) -> str:  # type: ignore[no-untyped-def]
    return str(entry.effect or entry.name)


def _known(solution: Solution) -> dict[object, tuple[int, str, float]]:
    """Number, name and u of every unknown that is known beforehand, by key."""
    return {
        e.key: (i, _name(e), e.prior_u)
        for i, e in enumerate(solution.nuisance_table)
        if np.isfinite(e.prior_u) and e.prior_u > 0.0
    }


def _effect_errors(state: State, keys: Sequence[object]) -> np.ndarray:
    """(n', e): S C e_ξ / u of every common unknown."""
    own, n = _known(state.solution), state.solution.model.n_parameters
    columns = [state.reach[:, n + own[key][0]] / own[key][2] for key in keys]
    return np.stack(columns, axis=1) if columns else np.zeros((len(state.map), 0))


def _everywhere(states: States) -> dict[object, tuple[int, str, float]]:
    """The unknowns known beforehand that all solutions have with the same u, as the first has them."""
    first, *others = [_known(s.solution) for s in states.states]
    return {
        key: own
        for key, own in first.items()
        if all(key in o and abs(o[key][2] - own[2]) <= SAME_U * own[2] for o in others)
    }


def _notes(everywhere: dict[object, tuple[int, str, float]], alike: set[str], decided: set[str]) -> tuple[str, ...]:
    """What was taken to be common without a word, and what might be."""
    notes = []
    if alike:
        name = sorted(alike)[0]
        notes.append(
            f"taken to be the same each time, because all campaigns name it alike: {', '.join(sorted(alike))}; if it was another "
            f"instrument, say so with `independent={name}`"
        )
    others = sorted({name for _, name, _ in everywhere.values()} - decided)
    if others:
        notes.append(
            f"counted as independent each time: {', '.join(others)}; where it was the same one, say so with "
            f"`common={others[0]}`, and it does not hide a change"
        )
    return tuple(notes)


def _unknown_priors(shared: Shared) -> list[str]:
    """Solutions whose prior is not known to be shared with another."""
    notes = []
    for i, state in enumerate(shared.of.states):
        known = any(both is not None for pair, both in shared.by_prior.items() if i in pair)
        if state.solution.prior_root is not None and not known:
            notes.append(
                f"{state.name} was fitted with an earlier solution as prior, which is none of these, or of which a part was "
                "released; where it stands on the same readings, u of the change is too large"
            )
    return notes


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
