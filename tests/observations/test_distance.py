"""Distances between any two bodies: readings of the exact chain, a recovery of rotary axes without a tool, files, bad input."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from exact_chain import COMPONENTS, Truth, apply, random_truth
from support.machines import STRUCTURES, exact_machine, resolved
from support.quick_fit import quick_fit
from support.rtests import index_grid
from support.sets import assert_same_set

from volid.campaign import Campaign, ObservationSet, Station
from volid.exceptions import InputError
from volid.fitting.location_errors import location_parameter
from volid.io import load_campaign, write_campaign, write_manifest
from volid.observations import KINDS
from volid.observations.base import NuisanceTable
from volid.virtual.simulate import simulate

TILTING = "tilting table C'A'"
STATION, REFLECTOR = np.array([700.0, -300.0, 250.0]), np.array([60.0, -90.0, 80.0])


def distances(exact, truth, q, station, reflector, on=("bed", "workpiece")) -> np.ndarray:
    """|reflector on one body - station on another| through the exact chain, (m,) [mm]."""
    place = apply(exact.body_pose(on[0], q, truth), station)
    return np.linalg.norm(apply(exact.body_pose(on[1], q, truth), reflector) - place, axis=1)


def reflector_set(q, d, *, body: str, place, station: str = "S", u: float = 0.0003, name: str = "reflector", **options):
    return ObservationSet(
        name, "distance", q, np.zeros_like(q), np.zeros((len(q), 3)), d[:, None], np.full((len(q), 1), u),
        {"station": np.full(len(q), station), "segment": np.full(len(q), "1")},
        options={"relative": False, "calibrated_u": 0.0, "target_body": body, "target": [float(c) for c in place]} | options,
    )  # fmt: skip


def random_positions(exact, m=40):
    low, high = np.array([exact.travel[a] for a in exact.axes]).T
    return low + np.random.default_rng(4).random((m, len(low))) * (high - low)


@pytest.mark.parametrize(
    "layout, station, target",
    [
        (TILTING, "bed", "workpiece"),
        (TILTING, "bed", "C"),  # the rotary table is the body that carries the workpiece
        (TILTING, "bed", "A"),  # the cradle
        (TILTING, "bed", "Y"),  # a carriage
        (TILTING, "workpiece", "Z"),
        (TILTING, "Z", "workpiece"),
        (TILTING, "A", "tool"),
        ("table and head", "workpiece", "X"),
        ("fork head CA", "bed", "C"),
        ("fork head CA", "workpiece", "tool"),
    ],
)
def test_distances_are_those_of_the_exact_chain(layout, station, target):
    exact = exact_machine(STRUCTURES[layout])
    truth = random_truth(exact, np.random.default_rng(6))
    if target == "tool":  # the functional point: through the tool frame's constants
        truth = Truth(truth.functions, {n: v for n, v in truth.constants.items() if n[3] != "S"})
    q = random_positions(exact)
    d = distances(exact, truth, q, STATION, REFLECTOR, (station, target))
    given = reflector_set(q, d, body=target, place=REFLECTOR)
    if target == "tool":
        given = replace(given, tool=np.tile(REFLECTOR, (len(q), 1)), options={"relative": False, "calibrated_u": 0.0})
    campaign = Campaign(resolved(exact), (Station("S", station, tuple(STATION), True, "machine"),), (given,))
    table = NuisanceTable()
    (group,) = KINDS["distance"].groups(given, campaign, table)
    values = np.array([e.start for e in table.entries])
    spindle = np.tile([truth.constants.get(f"{c}0S", 0.0) for c in COMPONENTS], (len(q), 1))
    errors = np.hstack([*(exact.errors(a, q, truth) for a in exact.axes), spindle])
    arrays = (jnp.asarray(q.T), tuple(jnp.asarray(given.tool.T)), jnp.asarray(errors.T))
    found = KINDS["distance"].predict(campaign.machine, group.settings, *arrays, jnp.asarray(values[group.slots]), None)
    np.testing.assert_allclose(np.asarray(found)[0], d, rtol=0, atol=1e-9)  # rotations enter to their third power
    assert np.abs(d - distances(exact, Truth(), q, STATION, REFLECTOR, (station, target))).max() > 0.005
    if target != "tool":
        (beam,) = KINDS["distance"].beams(given, campaign)
        plain = distances(exact, Truth(), q, STATION, REFLECTOR, (station, target))
        np.testing.assert_allclose(np.linalg.norm(beam.targets - STATION, axis=1), plain, atol=1e-9)


PLACES = {
    "S1": (900.0, -500.0, 200.0),
    "S2": (-800.0, -600.0, 500.0),
    "S3": (100.0, 900.0, 700.0),
    "S4": (50.0, -200.0, 1100.0),
}
REFLECTORS = ((120.0, 20.0, 60.0), (-70.0, 100.0, 90.0), (-30.0, -110.0, 140.0))


def test_reflectors_that_agree_to_six_digits_are_two_unknowns():
    exact = exact_machine("w C' A' Y' X' b Z t")
    q = np.tile([0.5 * sum(exact.travel[a]) for a in exact.axes], (4, 1))
    sets = [
        reflector_set(q, np.full(4, 900.0), body="workpiece", place=(1234.561, 20.0, z), name=f"R{z}")
        for z in (1000.001, 1000.002)
    ]
    table, campaign = (
        NuisanceTable(),
        Campaign(resolved(exact), (Station("S", "bed", tuple(STATION), known=True),), tuple(sets)),
    )
    for one in sets:
        KINDS["distance"].groups(one, campaign, table)
    found = [e.name for e in table.entries if e.name.startswith("target")]
    assert len(found) == len(set(found)) == 6


def test_reflectors_on_the_table_seen_from_the_bed_identify_both_rotary_axes():
    """Four placed stations, three reflectors of unknown place on the table, no tool: location errors and motions of C' and A'."""
    exact = exact_machine(STRUCTURES[TILTING])
    rng = np.random.default_rng(3)
    truth = random_truth(exact, rng, waviness=0.4)
    truth = Truth({n: f for n, f in truth.functions.items() if n[2] in "AC"},
                  {n: v for n, v in truth.constants.items() if n[3] in "AC"})  # fmt: skip
    q = index_grid(exact, {"A": 9, "C": 13})
    sets = []
    for i, place in enumerate(REFLECTORS):
        for station, position in PLACES.items():
            d = distances(exact, truth, q, position, place) + 0.0003 * rng.standard_normal(len(q))
            about = np.add(place, (1.5, -1.0, 0.8))
            sets.append(reflector_set(q, d, body="workpiece", place=about, station=station, name=f"{station} {i}"))
    off = '"E?[XYZ]" = false\n"E?0[XYZS]" = false\n'
    stations = tuple(Station(n, "bed", p, True, "machine") for n, p in PLACES.items())
    solution = quick_fit(Campaign(resolved(exact, off, segments=6), stations, tuple(sets)))
    assert solution.statements == () and len(solution.nuisance_table) == 12 + 9  # stations held, reflectors shared
    assert abs(np.sqrt(solution.adequacy.chi_square / solution.adequacy.degrees_of_freedom) - 1.0) < 0.1
    for name, value in truth.constants.items():
        row = location_parameter(solution, name)
        assert row.u < (2e-6 if name[1] in "ABC" else 0.0005)
        assert abs(row.value - value) < 3.5 * row.u, name
    normalised = []
    for name, function in truth.functions.items():
        rows = solution.motion(name, np.linspace(*exact.travel[name[2]], 15))
        seen = [r for r in rows if r.u > 1e-3 * max(x.u for x in rows)]
        normalised += [(r.value - function(r.position)) / r.u for r in seen]
    # some 90 coefficients, and a truth that the splines follow to some tenths of u
    assert 0.7 < np.sqrt(np.mean(np.square(normalised))) < 1.4
    targets = [i for i, e in enumerate(solution.nuisance_table) if e.name.startswith("target on workpiece")]
    places = np.asarray(solution.nuisance)[targets]
    u = np.sqrt(np.diag(np.asarray(solution.covariance))[solution.model.n_parameters + np.array(targets)])
    assert np.abs((places - np.ravel(REFLECTORS)) / u).max() < 4.0


def plan(machine, **options):
    q = index_grid(exact_machine(STRUCTURES[TILTING]), {"A": 3, "C": 5})
    empty = reflector_set(q, np.full(len(q), np.nan), body="A", place=REFLECTOR, **options)
    return Campaign(machine, (Station("S", "bed", tuple(STATION)),), (empty,))


def test_a_plan_is_simulated_and_files_lose_nothing(tmp_path):
    machine = resolved(exact_machine(STRUCTURES[TILTING]), segments=4)
    campaign, truth = simulate(plan(machine, target_u=0.0), seed=2, noise=False)
    assert np.isfinite(campaign.sets[0].readings).all() and truth.stations["S"] == tuple(STATION)
    folder = write_manifest(campaign, tmp_path / "text")
    for again in (load_campaign(folder), load_campaign(_saved(campaign, tmp_path / "c.h5"))):
        assert_same_set(replace(again.sets[0], source="", rows=None), replace(campaign.sets[0], source="", rows=None))
    text = folder.read_text()
    assert 'target_body = "A"' in text and "target = [60.0, -90.0, 80.0]" in text and "target_u = 0.0" in text


def _saved(campaign, path):
    write_campaign(campaign, path)
    return path


def test_a_set_without_tool_needs_no_tool_vector(tmp_path):
    machine = resolved(exact_machine(STRUCTURES[TILTING]), segments=4)
    campaign, _ = simulate(plan(machine), seed=2)
    folder = write_manifest(campaign, tmp_path / "text")
    csv = folder.parent / "reflector.csv"
    rows = [line.split(",") for line in csv.read_text().splitlines()]
    kept = [i for i, name in enumerate(rows[0]) if not name.startswith("tool_")]
    csv.write_text("\n".join(",".join(row[i] for i in kept) for row in rows) + "\n")
    assert not load_campaign(folder).sets[0].tool.any()


@pytest.mark.parametrize(
    "options, message",
    [
        ({"target_body": "B"}, "target_body is 'B'.*expected one of workpiece, bed, tool"),
        (
            {"target_body": "bed"},
            r"station 'S' and its target stand on the same body \(bed\), so their distance never changes",
        ),
        ({"target": []}, r"target_body = 'A', but target is missing; expected target = \[x, y, z\] in mm"),
        ({"target": [1.0, 2.0]}, r"target is \[1.0, 2.0\]; expected target = \[x, y, z\]"),
        ({"target_body": "tool"}, "target is for a reflector on another body; add target_body"),
    ],
)
def test_bad_targets(options, message, tmp_path):
    machine = resolved(exact_machine(STRUCTURES[TILTING]), segments=4)
    campaign = plan(machine)
    wrong = replace(campaign.sets[0], options=campaign.sets[0].options | options, readings=np.ones((15, 1)))
    write_campaign(replace(campaign, sets=(wrong,)), tmp_path / "c.h5")
    with pytest.raises(InputError, match=message):
        load_campaign(tmp_path / "c.h5")
