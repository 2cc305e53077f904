"""Monte Carlo refits: exact, the same however they are cut into batches, and what the summary of the samples says."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from support.machines import VERTICAL, fixed
from support.small_campaign import make_campaign
from support.trackers import simulated

from volid.campaign import Campaign, Effect
from volid.cli import main
from volid.effects.prediction import effect_samples
from volid.exceptions import InputError
from volid.fitting.diagnosis.robust import critical_value
from volid.fitting.fit import fit
from volid.io.solutions import read_solution, write_solution
from volid.uncertainty.budget import budget
from volid.uncertainty.outputs import headline_outputs
from volid.uncertainty.statement import statement
from volid.uncertainty.trials import curvature
from volid.uncertainty.trials.draws import pseudo_of, trial_noise
from volid.uncertainty.trials.monte_carlo import STAGE, _stage, fingerprint, monte_carlo
from volid.uncertainty.trials.refit import TOLERANCE, Refitter
from volid.uncertainty.trials.refit_steps import linear_step, turned
from volid.uncertainty.trials.run import BATCH, run_of, run_trials
from volid.uncertainty.trials.samples import TrialFolder
from volid.uncertainty.trials.second_order import second_order

EFFECTS = (
    Effect("refraction", "scale", 2e-6, "station", {"distribution": "rectangular"}),
    Effect("tip", "tool_length", 2e-3, "tool", {"components": "Z"}),
)


@pytest.fixture(scope="module")
def solution():
    """A small campaign with two correlated effects."""
    campaign, _, _ = simulated(VERTICAL, 4, extra=fixed(2), n_per_station=80, waviness=0.1)
    return fit(replace(campaign, sets=(replace(campaign.sets[0], effects=EFFECTS),)))


@pytest.fixture(scope="module")
def run(solution):
    return run_of(solution, seed=7)


@pytest.fixture(scope="module")
def sampled(solution):
    return monte_carlo(solution, 4 * BATCH, seed=7)


def with_readings(campaign: Campaign, flat: np.ndarray) -> Campaign:
    """The campaign with other readings, in the order of its sets."""
    sets, start = [], 0
    for s in campaign.sets:
        sets.append(replace(s, readings=flat[start : start + s.readings.size].reshape(s.readings.shape)))
        start += s.readings.size
    return replace(campaign, sets=tuple(sets))


def test_a_refit_is_the_fit_of_the_drawn_readings(solution, run):
    """Readings drawn, pseudo-readings of the effects at their stated value 0: the whole fit, begun anew, ends there too.

    But for 1e-4 u of the scales, because each fit multiplies them with the lengths of its own start values.
    """
    refitter = run.refitter
    noise, _ = trial_noise(7, 0, 2, refitter.n_readings, refitter.n_prior, run.pseudo)
    prior = np.tile(-(refitter.nuisance_prior @ refitter.centre), (2, 1))
    found = refitter.refit(noise, prior)
    assert not found.solved.any() and found.error.max() <= TOLERANCE
    u = np.sqrt(np.diagonal(np.asarray(solution.covariance)))
    for i in range(2):
        drawn = refitter.flat_predictions() + noise[i] * np.concatenate([s.u.ravel() for s in refitter.campaign.sets])
        again = fit(with_readings(solution.campaign, drawn))
        x = np.concatenate([np.asarray(again.parameters), np.asarray(again.nuisance)])
        assert np.abs(x - found.x[i])[u > 0].max() > 0.0
        np.testing.assert_allclose((x - found.x[i])[u > 0] / u[u > 0], 0.0, atol=1e-3)
        chi_square = again.adequacy.chi_square
        assert found.chi_square[i] == pytest.approx(chi_square, rel=1e-6)


def test_the_full_solver_agrees(run):
    """What a trial gets that does not converge: equal to one that does."""
    refitter = run.refitter
    noise, prior = trial_noise(7, 5, 1, refitter.n_readings, refitter.n_prior, run.pseudo)
    found = refitter.refit(noise, prior)
    x, chi_square = refitter.solve_fully(noise[0], prior[0], refitter.factors)
    seen = refitter.u > 0
    np.testing.assert_allclose(((x - found.x[0]) / np.where(seen, refitter.u, 1.0))[seen], 0.0, atol=1e-5)
    assert chi_square == pytest.approx(found.chi_square[0], rel=1e-8)


def test_the_stated_distance_to_the_minimum_holds(run):
    """Refits to second order against steps with the exact gradient that go on until nothing moves."""
    refitter, b = run.refitter, 300
    noise, prior = trial_noise(7, 0, b, refitter.n_readings, refitter.n_prior, run.pseudo)
    found = refitter.refit(noise, prior)
    x, seen = found.x - refitter.centre, refitter.u > 0
    for _ in range(2):
        x, _, chi_square = refitter._exact(x, noise, prior)
    away = np.abs((found.x - refitter.centre - x)[:, seen] / refitter.u[seen]).max(axis=1)
    assert np.all(away <= found.error + 1e-8) and found.error.max() <= TOLERANCE
    # as x: within a millionth of its standard deviation, which is that of chi-square with so many degrees of freedom
    spread = np.sqrt(2.0 * (refitter.n_readings + refitter.n_prior - np.count_nonzero(seen)))
    np.testing.assert_allclose(found.chi_square, chi_square, rtol=0, atol=TOLERANCE * spread)
    linear = np.asarray(linear_step(refitter.frozen, noise, prior)[0])
    bent = np.abs((linear - x)[:, seen] / refitter.u[seen]).max(axis=1)
    assert np.median(bent) > 100 * np.median(away), "the correction is what brings the trials there"


def test_small_tiles_take_only_the_splines_of_their_cells(monkeypatch):
    """Sorted by cells, a tile needs few columns of the bases: the same correction as with all of them in one tile."""
    campaign, _, _ = simulated(VERTICAL, 4, extra=fixed(9), n_per_station=250)
    run = run_of(fit(campaign), seed=7)
    refitter = run.refitter
    frozen, units = refitter.frozen, [entry.unit for entry in refitter.solution.nuisance_table]
    noise, _ = trial_noise(7, 0, 8, refitter.n_readings, refitter.n_prior, run.pseudo)
    steps = np.random.default_rng(0).standard_normal((8, len(refitter.u))) * refitter.u @ np.asarray(frozen.basis).T
    found, spans = [], []
    for rows in (8, 10_000):
        monkeypatch.setattr(curvature, "ROWS", rows)
        blocks = curvature.curvatures(refitter.problem.system, np.asarray(frozen.z), refitter.numbers, units)
        found.append(second_order(frozen.system, blocks, jnp.asarray(steps), turned(noise)))
        spans.append(sum(sum(c.spans) for c in blocks))
    assert spans[0] < 0.75 * spans[1]
    for one, other in zip(*found, strict=True):
        scale = np.abs(other).max(axis=0)
        np.testing.assert_allclose(
            one / np.where(scale > 0, scale, 1.0), other / np.where(scale > 0, scale, 1.0), atol=1e-5
        )


def test_rows_kept_and_rows_made_anew_give_the_same_step(run):
    """What a campaign too large for the rows to be kept does."""
    frozen = run.refitter.frozen
    assert frozen.weighted is not None
    noise, prior = trial_noise(3, 0, 20, run.refitter.n_readings, run.refitter.n_prior, run.pseudo)
    kept, anew = (linear_step(f, noise, prior) for f in (frozen, replace(frozen, weighted=None)))
    u = np.where(run.refitter.u > 0, run.refitter.u, 1.0)
    np.testing.assert_allclose(np.asarray(kept[0]) / u, np.asarray(anew[0]) / u, atol=1e-9)
    np.testing.assert_allclose(kept[1], anew[1], rtol=1e-10)


def test_trials_far_away_go_on_with_the_exact_gradient(run, monkeypatch):
    """Twenty times the noise: the third order is no longer small, and the answer is still the minimum."""
    refitter = run.refitter
    noise, prior = (20.0 * a for a in trial_noise(7, 0, 4, refitter.n_readings, refitter.n_prior, run.pseudo))
    calls = []
    exact = Refitter._exact
    monkeypatch.setattr(Refitter, "_exact", lambda self, *a: calls.append(len(a[0])) or exact(self, *a))
    found = refitter.refit(noise, prior)
    assert calls and calls[0] > 0
    seen = refitter.u > 0
    for i in range(4):
        x, _ = refitter.solve_fully(noise[i], prior[i], refitter.factors)
        np.testing.assert_allclose(((x - found.x[i])[seen]) / refitter.u[seen], 0.0, atol=2e-5)


def test_trials_that_do_not_converge_are_solved_anew(run, monkeypatch):
    noise, prior = trial_noise(7, 0, 3, run.refitter.n_readings, run.refitter.n_prior, run.pseudo)
    good = run.refitter.refit(noise, prior)
    monkeypatch.setattr("volid.uncertainty.trials.refit.STEPS", 0)
    again = run.refitter.refit(noise, prior)
    assert again.solved.all()
    seen = run.refitter.u > 0
    np.testing.assert_allclose(((again.x - good.x)[:, seen]) / run.refitter.u[seen], 0.0, atol=1e-5)


def test_draws_follow_from_seed_and_trial(solution, run):
    entries = tuple(solution.nuisance_table[j] for j in run.refitter.known)
    pseudo = pseudo_of(entries, effect_samples(solution.campaign))
    whole, few = trial_noise(3, 0, 10, 50, run.refitter.n_prior, pseudo), trial_noise(3, 4, 2, 50, 9, pseudo)[0]
    np.testing.assert_array_equal(whole[0][4:6], few)
    names = [e.name for e in entries]
    rectangular = [i for i, n in enumerate(names) if n.startswith("refraction")]
    draws = trial_noise(1, 0, 4000, 1, run.refitter.n_prior, pseudo)[1]
    assert len(rectangular) == 6 and np.abs(draws[:, rectangular]).max() <= np.sqrt(3)
    np.testing.assert_allclose(draws.std(axis=0), 1.0, atol=0.06)


def test_batches_do_not_matter(run):
    whole = run_trials(run, 0, 128)
    parts = [run_trials(run, i, 64) for i in (0, 64)]
    for name in ("x", "chi_square"):
        both = np.concatenate([p[name] for p in parts])
        scale = run.refitter.u if name == "x" else 1.0
        np.testing.assert_allclose((whole[name] - both) / np.where(scale == 0, 1, scale), 0.0, atol=1e-7)


def test_samples_scatter_as_the_covariance_says(solution, sampled):
    """The problem is all but linear: whitened samples have unit covariance within sampling error."""
    c = np.asarray(solution.covariance)
    u = np.sqrt(np.diagonal(c))
    values, vectors = np.linalg.eigh(c / np.outer(np.where(u == 0, 1, u), np.where(u == 0, 1, u)))
    seen = values > 1e-8
    x = sampled.samples.outputs(lambda v: v)
    centre = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)])
    z = ((x - centre) / np.where(u == 0, 1, u)) @ vectors[:, seen] / np.sqrt(values[seen])
    trials, p = len(x), int(seen.sum())
    assert trials == 4 * BATCH
    assert trials * np.sum(z.mean(axis=0) ** 2) < p + 4 * np.sqrt(2 * p)
    assert np.trace(z.T @ z) / trials == pytest.approx(p, abs=4 * np.sqrt(2 * p / trials))
    edge = np.sqrt(p / trials)  # Marchenko, Pastur
    sizes = np.linalg.eigvalsh(z.T @ z / trials)
    assert (1 - edge) ** 2 - 0.05 < sizes[0] and sizes[-1] < (1 + edge) ** 2 + 0.05
    dof = solution.adequacy.degrees_of_freedom
    chi = sampled.samples.chi_square
    assert chi.mean() == pytest.approx(dof, abs=4 * np.sqrt(2 * dof / trials))
    assert chi.std() == pytest.approx(np.sqrt(2 * dof), rel=0.06)


def test_propagation_is_enough_for_linear_outputs_and_not_for_the_largest_deviation(sampled):
    found = statement(sampled)
    linear = [row for row in found.rows if np.isfinite(row.u) and row.decided and row.u > 0]
    assert len(linear) > 50
    assert np.mean([row.valid for row in linear]) > 0.97
    for row in linear:
        assert row.u_mc == pytest.approx(row.u, rel=5 / np.sqrt(2 * sampled.samples.trials))
        assert row.shortest_high - row.shortest_low <= row.high - row.low
    (largest,) = [row for row in found.rows if row.name == "largest deviation"]
    assert np.isnan(largest.u) and largest.low < largest.value < largest.high
    assert found.failed == 0
    assert found.lack_of_fit.factor == 1.0 and found.lack_of_fit.grade == "accepted"


def test_an_interrupted_run_keeps_what_it_has(solution, tmp_path):
    """Interrupted after every batch and left with half a file; the end is the same to the last bit."""
    whole = monte_carlo(solution, 3 * BATCH, seed=2).samples.outputs(lambda v: v)
    folder, stops = tmp_path / "trials", 0

    def interrupt(message: str) -> None:
        if "trials (" in message and len(list(folder.glob("*.npz"))) > stops:
            raise KeyboardInterrupt

    for _ in range(12):
        try:
            found = monte_carlo(solution, 3 * BATCH, seed=2, folder=folder, resume=folder.exists(), progress=interrupt)
            break
        except KeyboardInterrupt:
            stops += 1
            (folder / ".half.part").write_bytes(b"half a batch")
    assert stops >= 2
    np.testing.assert_array_equal(found.samples.outputs(lambda v: v), whole)
    assert not (folder / ".half.part").exists()
    with pytest.raises(InputError, match="holds the trials of an interrupted run; go on with `resume=True`"):
        monte_carlo(solution, 3 * BATCH, seed=2, folder=folder)
    with pytest.raises(InputError, match="another run \\(seed differs\\)"):
        monte_carlo(solution, 3 * BATCH, seed=3, folder=folder, resume=True)


def test_robust_fits_search_their_outliers_again(tmp_path):
    """A gross error in one trial is set aside there; what is left agrees with the trial without it."""
    from volid.io import load_campaign

    solution = fit(load_campaign(make_campaign(tmp_path).manifest), robust=True)
    refitter = Refitter(solution)
    noise = trial_noise(2, 0, 2, refitter.n_readings, 0, pseudo_of((), {}))[0]
    limit = critical_value(refitter.n_readings)
    clean = refitter.refit(noise)
    noise[1, 17] += 10 * limit / np.sqrt(refitter.redundancy()[17])
    found = refitter.refit(noise)
    assert found.outliers.tolist() == [clean.outliers[0], 1] and clean.outliers.tolist() == [0, 0]
    shift = np.abs(found.x[1] - clean.x[1]) / np.where(refitter.u == 0, 1, refitter.u)
    assert 0 < shift.max() < 1.5, "one reading less"
    plain = Refitter(replace(solution, options={**solution.options, "robust": False})).refit(noise)
    assert (np.abs(plain.x[1] - clean.x[1]) / np.where(refitter.u == 0, 1, refitter.u)).max() > 3.0


def test_samples_follow_a_change_of_datum(sampled):
    """A sample in the new datum is the solution with that sample's parameters, changed to it."""
    datum = replace(sampled.datum, primary="Y", secondary="Z")
    changed = sampled.in_datum(datum)
    n = sampled.model.n_parameters
    x = next(sampled.samples.batches())[5]
    one = replace(sampled, parameters=x[:n], nuisance=x[n:], samples=None).in_datum(datum)
    found = next(changed.samples.batches())[5]
    np.testing.assert_allclose(found[: one.model.n_parameters], np.asarray(one.parameters), atol=1e-12)
    before, after = statement(sampled), statement(changed)
    one, other = (next(r for r in s.rows if r.name == "RMS deviation") for s in (before, after))
    assert one.u_mc > 0 and other.u_mc > 0


@pytest.mark.slow
def test_adaptive_runs_reach_the_digits(solution):
    """JCGM 101 7.9.4: whole stages of 10,000, the tolerance reached; u within half a digit of a run of its own."""
    found = monte_carlo(solution, digits=1, seed=11)
    assert found.samples.trials % 10_000 == 0 and found.samples.trials >= 20_000
    assert 0.0 < found.samples.tolerance <= 1.0
    with pytest.raises(InputError, match="5 significant digits; expected 1 to 4"):
        monte_carlo(solution, digits=5)


def test_budget_adds_up(solution):
    """Contributions of independent sources add up to the covariance; one source of one reading by hand."""
    found = budget(solution)
    assert set(found.sources) == {"readings of set 'volume'", "effect 'refraction'", "effect 'tip'"}
    np.testing.assert_allclose(
        found.covariances.sum(axis=0),
        np.asarray(solution.covariance),
        rtol=0,
        atol=1e-9 * float(np.max(np.diagonal(np.asarray(solution.covariance)))),
    )
    outputs = headline_outputs(solution)
    u = statement_u(solution, outputs.rows)
    np.testing.assert_allclose(np.sqrt((found.contributions(outputs.rows) ** 2).sum(axis=0)), u, rtol=1e-5)
    table = found.root_mean_square(outputs.rows)
    assert sum(share for _, _, share in table) == pytest.approx(1.0)
    assert [v for _, v, _ in table] == sorted((v for _, v, _ in table), reverse=True)


def test_every_set_is_a_source(solution):
    (s,) = solution.campaign.sets
    even = np.arange(len(s.readings)) % 2 == 0
    parts = tuple(replace(s.rows_of(rows), name=name) for name, rows in (("even", even), ("odd", ~even)))
    two = fit(replace(solution.campaign, sets=parts))
    found = budget(two)
    assert {"readings of set 'even'", "readings of set 'odd'"} < set(found.sources)
    covariance = np.asarray(two.covariance)
    np.testing.assert_allclose(
        found.covariances.sum(axis=0), covariance, rtol=0, atol=1e-9 * np.diagonal(covariance).max()
    )
    even, odd = (np.trace(found.covariances[found.sources.index(f"readings of set '{n}'")]) for n in ("even", "odd"))
    assert 0.2 < even / odd < 5.0


def test_a_source_contributes_what_its_scatter_does(solution, run):
    """Only the scales drawn, the rest exact: the refits scatter by that source's contribution."""
    refitter, found = run.refitter, budget(solution)
    noise, prior = trial_noise(9, 0, 1024, refitter.n_readings, refitter.n_prior, run.pseudo)
    entries = [solution.nuisance_table[j] for j in refitter.known]
    other = [i for i, e in enumerate(entries) if e.effect != "refraction"]
    prior[:, other] = 0.0
    x = refitter.refit(np.zeros_like(noise), prior).x
    rows = headline_outputs(solution).rows
    u = found.contributions(rows)[found.sources.index("effect 'refraction'")]
    large = u > 0.05 * u.max()
    np.testing.assert_allclose((x @ rows.T).std(axis=0)[large], u[large], rtol=5 / np.sqrt(2 * 1024))


def statement_u(solution, rows: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("qi,ij,qj->q", rows, np.asarray(solution.covariance), rows))


def test_effects_of_single_readings_scatter_as_stated(solution):
    """A U-shaped offset of every reading, far larger than the noise: whitened noise within ±√2, two heaps at the ends."""
    offset = Effect("electronics", "offset", 1e-2, "point", {"distribution": "U-shaped"})
    (s,) = solution.campaign.sets
    campaign = replace(solution.campaign, sets=(replace(s, effects=(*s.effects, offset)),))
    run = run_of(replace(solution, campaign=campaign), seed=2)
    noise, _ = trial_noise(2, 0, 40, run.refitter.n_readings, run.refitter.n_prior, run.pseudo)
    assert noise.std() == pytest.approx(1.0, abs=0.02) and abs(noise.mean()) < 0.02
    # share of |x| > 1 of a U-shaped distribution of unit variance: 1 - (2/π) asin(1/√2) = 1/2; of a normal one 0.317
    assert np.mean(np.abs(noise) > 1.0) == pytest.approx(0.5, abs=0.02)
    assert np.abs(noise).max() < np.sqrt(2.0) + 0.3


def test_a_run_is_known_by_its_effects_and_its_batches_by_their_run(solution, tmp_path):
    (s,) = solution.campaign.sets
    normal = replace(s, effects=(replace(EFFECTS[0], options={}), EFFECTS[1]))
    other = replace(solution, campaign=replace(solution.campaign, sets=(normal,)))
    assert fingerprint(other) != fingerprint(solution), "only a distribution differs"
    assert fingerprint(replace(solution, options={"robust": True})) != fingerprint(solution)
    here = tmp_path / "trials"
    with pytest.raises(RuntimeError, match="stop"):
        monte_carlo(solution, 2 * BATCH, seed=1, folder=here, progress=_stop_after_a_batch)
    (here / "run.json").unlink()  # what a death while the folder is removed may leave
    found = monte_carlo(solution, BATCH, seed=2, folder=here)
    fresh = monte_carlo(solution, BATCH, seed=2)
    np.testing.assert_array_equal(next(iter(found.samples.batches())), next(iter(fresh.samples.batches())))


def _stop_after_a_batch(message: str) -> None:
    if " of 2048 trials" in message:
        raise RuntimeError("stop")


def test_a_run_that_never_starts_leaves_nothing(solution, tmp_path):
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        monte_carlo(solution, 100, folder=tmp_path / "trials", scheduler="tcp://127.0.0.1:1")
    assert list(tmp_path.iterdir()) == []


def test_trials_that_do_not_converge_do_not_count_as_digits_reached(solution, tmp_path):
    run = run_of(solution, seed=3)
    store = TrialFolder(tmp_path / "t", {"seed": 3, "batch": BATCH, "solution": "x"}, resume=False)
    arrays = run_trials(run, 0, BATCH)
    outputs = headline_outputs(solution)
    for batch in range(-(-STAGE // BATCH)):
        store.save(batch, arrays)
    whole = _stage(store, outputs, 0)
    arrays["x"][5] = np.nan
    store.save(0, arrays)
    left = _stage(store, outputs, 0)
    assert np.isfinite(left).all()
    np.testing.assert_allclose(left[1], whole[1], rtol=0.01)


def test_on_the_command_line(solution, tmp_path, capsys):
    place, out = tmp_path / "s.h5", tmp_path / "mc.h5"
    write_solution(solution, place)
    assert main(["uncertainty", str(place), "--trials", "1500", "--seed", "7", "-o", str(out)]) == 0
    text = capsys.readouterr().out
    assert "Monte Carlo: 1500 refits" in text and "largest deviation" in text and f"written: {out}" in text
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mc.h5", "s.h5"]
    found = read_solution(out)
    assert found.samples.trials == 1500 and json.loads(found.provenance["uncertainty options"])["seed"] == 7
    assert main(["uncertainty", str(place), "--trials", "1500", "--seed", "7", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["trials"] == 1500 and {"low", "high", "shortest_low", "u", "u_mc"} <= set(data["rows"][0])
    assert main(["uncertainty", str(place), "--resume"]) == 2
    assert main(["uncertainty", str(place), "--trials", "19"]) == 2
    assert "argument --trials: '19': expected a whole number" in capsys.readouterr().err
