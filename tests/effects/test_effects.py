"""Systematic effects: what each does to a reading in closed form, what the fit makes of them, and wrong ones named."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaign_files import MACHINE, MANIFEST, edited, write_files
from support.judging import judge
from support.machines import VERTICAL, fixed
from support.trackers import simulated

from volid.campaign import Campaign, Effect, ObservationSet, Station
from volid.effects.drift import NODES
from volid.exceptions import InputError
from volid.fitting.equations.problem import build_problem, scatter, with_random_effects
from volid.fitting.fit import fit
from volid.io.campaign.manifest import read_manifest
from volid.io.machines import parse_machine
from volid.virtual.simulate import simulate

SMALL = parse_machine(MACHINE + "[model]\nsegments = 2\n", "m.toml")
HOURS = np.array([0.0, 1.0, 2.0, 4.0])


def along_x(*effects: Effect, readings=(500.0, 600.0, 700.0, 800.0)) -> Campaign:
    """Distances along X from a known station; the tool vector points at the station as well."""
    m = len(readings)
    positions = np.column_stack([np.array(readings) - 100.0, np.zeros(m), np.zeros(m)])
    one = ObservationSet(
        "line",
        "distance",
        positions,
        np.zeros((m, 3)),
        np.tile([100.0, 0.0, 0.0], (m, 1)),
        np.array(readings)[:, None],
        np.full((m, 1), 0.0003),
        {"station": np.array(["S1", "S1", "S2", "S2"]), "segment": np.array(["1", "2", "1", "1"])},
        time=3600.0 * HOURS,
        temperature=np.array([20.0, 21.0, 22.0, 23.0]),
        options={"relative": False, "calibrated_u": 0.0},
        effects=effects,
    )
    stations = tuple(Station(s, position=(0.0, 0.0, 0.0), known=True, frame="machine") for s in ("S1", "S2"))
    return Campaign(SMALL, stations, (one,))


def change(campaign: Campaign, values: dict[str, float]) -> np.ndarray:
    """What nuisance parameters `values`, by name, do to the four readings."""
    problem = build_problem(campaign, _model())
    names = [e.name for e in problem.nuisance]
    assert set(values) <= set(names), names
    z = problem.start.copy()
    for name, value in values.items():
        z[problem.model.layout.n_coefficients + names.index(name)] += value
    before, after = (scatter(problem, campaign, problem.equations.predictions(v))[0] for v in (problem.start, z))
    return (after - before)[:, 0]


def _model():
    from volid.model.error_functions import motion_names
    from volid.model.error_model import build_model

    return build_model(SMALL, {n: (2,) for n in motion_names(SMALL)})


def test_scale_per_station():
    found = change(along_x(Effect("n", "scale", 1e-6, "station")), {"n S1": 1e-6, "n S2": 2e-6})
    np.testing.assert_allclose(found, [0.5e-3, 0.6e-3, 1.4e-3, 1.6e-3], rtol=1e-7)


def test_offset_per_segment_and_campaign():
    both = along_x(Effect("a", "offset", 1e-3, "segment"), Effect("b", "offset", 1e-3, "campaign"))
    found = change(both, {"a S1 segment 2": 0.001, "b": 0.01})
    np.testing.assert_allclose(found, [0.01, 0.011, 0.01, 0.01], rtol=1e-7)


def test_linear_drift_starts_with_each_scope():
    found = change(along_x(Effect("d", "drift", 1e-3, "station")), {"d S1": 0.003, "d S2": 0.001})
    np.testing.assert_allclose(found, [0.0, 0.003, 0.0, 0.002], atol=1e-12)


def test_random_walk_adds_up_its_increments():
    walk = along_x(Effect("w", "drift", 1e-3, "campaign", {"form": "random walk"}))
    steps = {f"w step {i + 1}": 0.001 * (i + 1) for i in range(NODES)}
    position = HOURS / HOURS[-1] * NODES  # straight between the nodes
    sums = np.concatenate([[0.0], np.cumsum([0.001 * (i + 1) for i in range(NODES)])])
    np.testing.assert_allclose(change(walk, steps), np.interp(position, np.arange(NODES + 1), sums), atol=1e-12)
    entries = [e for e in build_problem(walk, _model()).nuisance if e.effect == "w"]
    total = np.sqrt(sum(e.prior_u**2 for e in entries))
    assert total == pytest.approx(1e-3 * np.sqrt(4.0)), "4 h of 1 µm/√h"


def two_days(*effects: Effect) -> Campaign:
    """`along_x` in two sets with one clock: the first and the last two readings."""
    whole = along_x(*effects)
    (one,) = whole.sets
    return replace(
        whole, sets=tuple(rows_of(one, rows, name) for rows, name in ((slice(0, 2), "a"), (slice(2, 4), "b")))
    )


def rows_of(s: ObservationSet, rows: slice, name: str) -> ObservationSet:
    arrays = {
        key: getattr(s, key)[rows]
        for key in ("positions", "directions", "tool", "readings", "u", "time", "temperature")
    }
    return replace(s, name=name, labels={k: v[rows] for k, v in s.labels.items()}, **arrays)


def changes(campaign: Campaign, values: dict[str, float]) -> np.ndarray:
    """`change` for campaigns of several sets."""
    problem = build_problem(campaign, _model())
    names, z = [e.name for e in problem.nuisance], problem.start.copy()
    for name, value in values.items():
        z[problem.model.layout.n_coefficients + names.index(name)] += value
    before, after = (scatter(problem, campaign, problem.equations.predictions(v)) for v in (problem.start, z))
    return np.concatenate([(a - b)[:, 0] for a, b in zip(after, before, strict=True)])


def test_drift_of_a_campaign_goes_on_from_set_to_set():
    found = changes(two_days(Effect("d", "drift", 1e-3, "campaign")), {"d": 0.003})
    np.testing.assert_allclose(found, 0.003 * HOURS, atol=1e-12)
    steps = {f"w step {i + 1}": 0.001 * (i + 1) for i in range(NODES)}
    walk = Effect("w", "drift", 1e-3, "campaign", {"form": "random walk"})
    np.testing.assert_allclose(changes(two_days(walk), steps), change(along_x(walk), steps), atol=1e-12)


def test_scale_of_each_component_of_a_sensor():
    """Three sensors of an R-test, each with a scale of its own: displacements (0.1, 0.2, 0.3) mm."""
    m, seen = 2, np.array([[0.1, 0.2, 0.3], [0.1, 0.2, -0.3]])
    sensor = ObservationSet(
        "rtest", "displacement", np.zeros((m, 3)), np.zeros((m, 3)), np.zeros((m, 3)), seen, np.full((m, 3), 1e-3),
        {"sphere": np.array(["1", "1"])}, options={"sphere": (0.1, 0.2, 0.3)},
        effects=(Effect("s", "scale", 1e-3, "set", {"components": "XZ"}),),
    )  # fmt: skip
    campaign = Campaign(SMALL, (), (sensor,))
    problem = build_problem(campaign, _model())
    names, z = [e.name for e in problem.nuisance], problem.start.copy()
    for name, value in (("s rtest X", 1e-3), ("s rtest Z", 2e-3)):
        z[problem.model.layout.n_coefficients + names.index(name)] += value
    before, after = (scatter(problem, campaign, problem.equations.predictions(v))[0] for v in (problem.start, z))
    np.testing.assert_allclose(after - before, [[1e-4, 0.0, 6e-4], [1e-4, 0.0, -6e-4]], atol=1e-12)


def test_what_expands_is_the_length_without_the_dead_path():
    """A dead path of 300 mm in every reading: expansion acts on reading - 300 mm, at each reading's own temperature."""
    options = {"expansion": 11e-6, "u_expansion": 1e-6, "distribution": "rectangular"}
    hot = along_x(Effect("T", "temperature", 0.1, "set", options))
    hot = replace(hot, sets=(replace(hot.sets[0], options={"relative": True}),))
    beams = {(s, g) for s, g in zip(*hot.sets[0].labels.values(), strict=True)}
    problem = build_problem(hot, _model(), {("dead path", str(s), str(g)): 300.0 for s, g in beams})
    names, z = [e.name for e in problem.nuisance], problem.start.copy()
    z[problem.model.layout.n_coefficients + names.index("T expansion")] += 1e-6
    before, after = (scatter(problem, hot, problem.equations.predictions(v))[0] for v in (problem.start, z))
    x = np.array([200.0, 300.0, 400.0, 500.0])
    np.testing.assert_allclose((after - before)[:, 0], x * 1e-6 * np.arange(4), rtol=1e-7)
    kinds = {e.name: e.distribution for e in problem.nuisance if e.effect}
    assert kinds == {"T line": "rectangular", "T expansion": "normal"}


def test_closures_determine_the_drift():
    """One point read at the beginning, in the middle and at the end: the drift is known from it, not from what was stated."""
    closure, drift = 1e-4, Effect("d", "drift", 0.1, "campaign")
    readings = np.array([500.0, 500.0 + 2 * 0.005, 500.0 + 4 * 0.005])
    line = along_x(drift, readings=(500.0, 500.0, 500.0, 500.0))
    one = rows_of(line.sets[0], slice(0, 3), "line")
    one = replace(
        one, readings=readings[:, None], u=np.full((3, 1), closure), time=3600.0 * np.array([0.0, 2.0, 4.0]),
        labels={"station": np.array(["S1"] * 3), "segment": np.array(["1"] * 3)}, options={"relative": True},
    )  # fmt: skip
    campaign = replace(line, sets=(one,), stations=line.stations[:1])
    problem = build_problem(campaign, _model())
    normal = problem.equations.normal(problem.start)
    n = problem.model.layout.n_coefficients
    own = [n + i for i, e in enumerate(problem.nuisance) if e.name == "d" or e.name.startswith("dead path")]
    matrix = np.asarray(normal.matrix)[np.ix_(own, own)]
    found = np.linalg.solve(matrix, -np.asarray(normal.gradient)[own])
    drifts = [i for i, j in enumerate(own) if problem.nuisance[j - n].name == "d"]
    assert found[drifts[0]] == pytest.approx(0.005, rel=1e-3)
    # straight line through 0, 2, 4 h: u = closure / sqrt(Σ (t - mean)²) = closure / sqrt(8)
    assert np.sqrt(np.linalg.inv(matrix)[drifts[0], drifts[0]]) == pytest.approx(closure / np.sqrt(8.0), rel=1e-3)


def test_tool_vector_moves_the_functional_point():
    tool = along_x(Effect("t", "tool_length", 1e-3, "tool", {"components": "XZ"}))
    name = "t tool (100, 0, 0)"
    found = change(tool, {f"{name} X": 0.002, f"{name} Z": 0.05})
    x = np.array([500.0, 600.0, 700.0, 800.0])
    np.testing.assert_allclose(found, np.hypot(x + 0.002, 0.05) - x, atol=1e-12)


def test_temperature_has_two_parts():
    options = {"expansion": 11e-6, "u_expansion": 1e-6}
    hot = along_x(Effect("T", "temperature", 0.1, "set", options))
    found = change(hot, {"T line": 0.1, "T expansion": 1e-6})
    x = np.array([500.0, 600.0, 700.0, 800.0])
    np.testing.assert_allclose(found, x * (11e-6 * 0.1 + 1e-6 * np.arange(4)), rtol=1e-7)


def test_what_is_drawn_anew_enlarges_u():
    campaign = along_x(
        Effect("r", "repeatability", 1e-3, "point", {"axes": {"X": 4e-4, "Y": 1.0}}),
        Effect("s", "scale", 1e-6, "point"),
    )
    u = with_random_effects(campaign).sets[0].u[:, 0]
    x = np.array([500.0, 600.0, 700.0, 800.0])
    np.testing.assert_allclose(u, np.sqrt(3e-4**2 + 4e-4**2 + (1e-6 * x) ** 2), rtol=1e-9)
    assert (campaign.sets[0].u == 3e-4).all(), "the campaign keeps the instrument's u"


def test_the_same_effect_in_two_sets_is_one():
    campaign = along_x(Effect("n", "scale", 1e-6, "station"))
    second = replace(campaign.sets[0], name="again")
    both = replace(campaign, sets=(campaign.sets[0], second))
    assert len(build_problem(both, _model()).nuisance) == len(build_problem(campaign, _model()).nuisance)
    other = replace(second, effects=(Effect("n", "scale", 2e-6, "station"),))
    with pytest.raises(InputError, match="effect 'n': u is 2e-06 in one set and another in the next"):
        build_problem(replace(campaign, sets=(campaign.sets[0], other)), _model())


# ------------------------------------------------------------------------------------------------------------- in a fit


def with_effect(campaign: Campaign, *effects: Effect) -> Campaign:
    return replace(campaign, sets=(replace(campaign.sets[0], effects=effects), *campaign.sets[1:]))


@pytest.fixture(scope="module")
def scaled():
    """Six stations whose scales are wrong by up to 5 ppm: campaign, exact truth, and the scales."""
    campaign, truth, tracker = simulated(VERTICAL, 4, extra=fixed(6), n_per_station=120, waviness=0.4)
    scales = dict(zip(tracker.station_positions, 1e-6 * np.array([5.0, -4.0, 3.0, 1.0, -2.0, -5.0]), strict=True))
    own = campaign.sets[0]
    factor = np.array([scales[s] for s in own.labels["station"]])[:, None]
    beam = np.array(
        [tracker.dead_paths[s, int(g)] for s, g in zip(own.labels["station"], own.labels["segment"], strict=True)]
    )
    readings = own.readings + factor * (own.readings - beam[:, None])  # the air between station and target
    return replace(campaign, sets=(replace(own, readings=readings),)), truth, scales


def test_scale_errors_of_the_stations_are_found_and_left_out_they_reject_the_model(scaled):
    campaign, truth, scales = scaled
    without = fit(campaign)
    assert without.adequacy.rejected and without.adequacy.causes[0].cause == "scale of a station"
    solution = fit(with_effect(campaign, Effect("refraction", "scale", 4e-6, "station")))
    assert not solution.adequacy.rejected, solution.adequacy.verdict
    names = [e.name for e in solution.nuisance_table]
    for station, scale in scales.items():
        i = names.index(f"refraction {station}")
        u = float(np.sqrt(solution.covariance[i + solution.model.n_parameters, i + solution.model.n_parameters]))
        assert u < 4e-6, "the data know more than the statement"
        assert abs(float(solution.nuisance[i]) - scale) < 4 * u
    with_it, left_out = (judge(s, VERTICAL, truth) for s in (solution, without))
    assert 0.6 < with_it.normalised_rms < 1.4  # one seed, some 100 effective values
    assert without.factor * left_out.normalised_rms > 2.0, "with the stated u alone"


def test_virtual_machine_draws_effects(scaled):
    campaign = with_effect(scaled[0], Effect("refraction", "scale", 4e-6, "station", {"distribution": "rectangular"}))
    clean, _ = simulate(scaled[0], seed=3, noise=False)
    drawn, truth = simulate(campaign, seed=3, noise=False)
    values = {n.removeprefix("refraction "): v for n, v in truth.instruments.items() if n.startswith("refraction ")}
    assert len(values) == 6 and max(map(abs, values.values())) <= 4e-6 * np.sqrt(3)
    expected = np.array([values[s] for s in drawn.sets[0].labels["station"]])[:, None] * clean.sets[0].readings
    np.testing.assert_allclose(drawn.sets[0].readings - clean.sets[0].readings, expected, rtol=1e-6)


# ------------------------------------------------------------------------------------------------------------ bad input


@pytest.mark.parametrize(
    ("new", "message"),
    [
        (
            'distribution = "normaal"',
            r"effect 'refraction': distribution is \"normaal\"; expected one of .*did you mean 'normal'",
        ),
        ("half_width = 1.0e-7", r"half_width is 1e-07; expected u, or a distribution that has bounds"),
        ("samples = [1.0, 1.0]", r"samples is .*; expected at least two different values"),
        ('samples = [1.0, "x"]', r"samples is .*; expected a list of numbers"),
        ("axes = { X = 0.001 }", r"effect 'refraction': unknown key 'axes'"),
        ('components = "Z"', r"effect 'refraction': components = .Z., but a 'distance' reading has DISTANCE"),
        ('file = "nowhere.csv"', r"nowhere.csv"),
    ],
)
def test_wrong_effects_are_named(tmp_path, new, message):
    text = edited(MANIFEST, 'distribution = "rectangular"', new)
    with pytest.raises(InputError, match=message):
        read_manifest(write_files(tmp_path, manifest=text))


def test_drift_without_times_and_stations_that_a_kind_has_not(tmp_path):
    text = edited(MANIFEST, 'type = "scale"', 'type = "drift"')
    with pytest.raises(InputError, match="set 'volume', effect 'refraction': drift needs a time"):
        read_manifest(write_files(tmp_path, manifest=text))
    text = MANIFEST + '[[set.effect]]\nname = "o"\ntype = "offset"\nu = 1e-6\nper = "station"\n'
    with pytest.raises(
        InputError, match="set 'levels', effect 'o': per = \"station\", but a 'component' set has no stations"
    ):
        read_manifest(write_files(tmp_path / "two", manifest=text))


def test_half_width_and_sample_file(tmp_path):
    text = edited(MANIFEST, "u = 2.0e-7", "half_width = 3.0e-7")
    found = read_manifest(write_files(tmp_path, manifest=text)).sets[0].effects[0]
    assert found.u == pytest.approx(3e-7 / np.sqrt(3))
    folder = tmp_path / "samples"
    text = edited(edited(MANIFEST, "u = 2.0e-7\n", ""), 'distribution = "rectangular"', 'file = "scales.csv"')
    manifest = write_files(folder, manifest=text)
    (folder / "scales.csv").write_text("value\n1e-7\n3e-7\n8e-7\n")
    found = read_manifest(manifest).sets[0].effects[0]
    assert found.options == {"distribution": "samples", "samples": [1e-7, 3e-7, 8e-7]}
    assert found.u == pytest.approx(np.std([1e-7, 3e-7, 8e-7], ddof=1))
