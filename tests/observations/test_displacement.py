"""R-test displacements: readings of the exact chain, files that lose nothing, a fit that finds the errors, and bad input."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from exact_chain import COMPONENTS
from support.machines import LAYOUTS, exact_machine
from support.rtests import NO_LINEAR, SPHERES, TOOLS, displacement, rotary_truth, rtest, small_rotation
from support.sets import assert_same_set

from volid.campaign import Campaign, standard_uncertainty
from volid.exceptions import InputError, OutputError
from volid.fitting.fit import fit
from volid.fitting.location_errors import location_parameter
from volid.io import load_campaign, write_campaign, write_manifest
from volid.observations import KINDS
from volid.observations.base import NuisanceTable
from volid.plausibility.checks import check_campaign

THIRD_ORDER = 3e-10  # mm: rotations of 100 µrad enter to second order, over 1 m


def predicted(campaign: Campaign, exact, truth, true: dict[str, float]) -> np.ndarray:
    """The kind's own prediction from the exact chain's error values, nuisance parameters `true` by name, (m, 3)."""
    readings, table = campaign.sets[0], NuisanceTable()
    (group,) = KINDS["displacement"].groups(readings, campaign, table)
    values = np.array([true.get(entry.name, 0.0) for entry in table.entries])
    q = readings.positions
    spindle = np.tile([truth.constants.get(f"{c}0S", 0.0) for c in COMPONENTS], (len(q), 1))
    errors = np.hstack([*(exact.errors(a, q, truth) for a in exact.axes), spindle])
    arrays = (jnp.asarray(q.T), tuple(jnp.asarray(readings.tool.T)), jnp.asarray(errors.T))
    slots = jnp.asarray(values[group.slots])
    return np.asarray(KINDS["displacement"].predict(campaign.machine, group.settings, *arrays, slots, None)).T


@pytest.mark.parametrize("on_tool", [True, False])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_displacements_are_those_of_the_exact_chain(layout, on_tool):
    exact = exact_machine(LAYOUTS[layout])
    truth = rotary_truth(exact)
    truth.constants.update(EX0S=0.01, EZ0S=-0.02, EB0S=4e-5)
    campaign = rtest(exact, truth, n=(3, 5), on_tool=on_tool, noise=False)
    true = {f"sphere {s} {c}": x for s, place in SPHERES.items() for c, x in zip("XYZ", place, strict=True)}
    expected = campaign.sets[0].readings
    assert np.abs(expected).max() > 0.01, "errors too small to test anything"
    np.testing.assert_allclose(predicted(campaign, exact, truth, true), expected, rtol=0, atol=THIRD_ORDER)


@pytest.mark.parametrize("on_tool", [True, False])
def test_nest_rotation_and_scale_of_the_sensor(on_tool):
    exact = exact_machine(LAYOUTS["split C and B"])
    truth = rotary_truth(exact)
    unknown = {"nest_u": np.inf, "rotation_u": 0.01, "scale_u": 1e-3}
    campaign = rtest(exact, truth, n=(3, 5), on_tool=on_tool, noise=False, **unknown)
    readings = campaign.sets[0]
    true = {f"sphere {s} {c}": x for s, place in SPHERES.items() for c, x in zip("XYZ", place, strict=True)}
    nest, turn, scale = np.array([0.3, -0.2, 0.1]), np.array([1e-3, 2e-3, -3e-3]), 1e-3
    true |= {f"nest R-test {c}": x for c, x in zip("XYZ", nest, strict=True)}
    true |= {f"rotation R-test {c}": x for c, x in zip("ABC", turn, strict=True)}
    d = np.zeros_like(readings.readings)
    for (sphere, place), tool in zip(SPHERES.items(), TOOLS, strict=True):
        rows = readings.labels["sphere"] == sphere
        d[rows] = displacement(exact, readings.positions[rows], np.array(tool) + nest, place, truth, on_tool)
    expected = (1 + scale) * d @ small_rotation(turn).T
    found = predicted(campaign, exact, truth, true | {"scale R-test": scale})
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)  # turn³/6 over the displacement of 0.4 mm: 4e-9


def test_the_fit_finds_location_errors_and_motions_of_a_tilting_table():
    exact = exact_machine(LAYOUTS["table C on A"])
    truth = rotary_truth(exact)
    model = "[model]\nsegments = 6\n" + NO_LINEAR + '"E?0S" = false\n"E?C" = { segments = 12 }\n'
    solution = fit(rtest(exact, truth, n=(19, 11), u=0.003, extra=model))
    assert solution.statements == ()
    assert solution.adequacy.verdict == "model accepted by the data"
    names = [n for n in solution.model.names if "0" in n]
    assert set(names) == set(truth.constants)
    for name in names:
        found = location_parameter(solution, name)
        assert abs(found.value - truth.constants[name]) < 4 * found.u, name
        assert found.u < (8e-6 if name[1] in "ABC" else 8e-4), name
    for name in solution.model.segments:
        x = np.linspace(*exact.travel[name[2]], 10)  # angular positioning is 0 at 0, with u = 0: not among these
        found = solution.motion(name, x)
        off = [(v.value - t) / v.u for v, t in zip(found, truth.functions[name](x), strict=True)]
        assert np.sqrt(np.mean(np.square(off))) < 2.5, name


# -------------------------------------------------------------------------------------------------------- files


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    """An R-test with everything that a set can hold: several spheres and tools, unknown nest, u of each coordinate."""
    exact = exact_machine(LAYOUTS["table C on A"])
    made = rtest(exact, rotary_truth(exact), n=(3, 4), nest_u=np.inf, rotation_u=1e-3, scale_u=0.0, range=1.5)
    u = made.sets[0].u * np.array([1.0, 1.5, 2.0]) * (1 + 0.1 * np.arange(len(made.sets[0])))[:, None]
    return replace(made, sets=(replace(made.sets[0], u=u),))


@pytest.mark.parametrize("form", ["text", "hdf5"])
def test_files_lose_nothing(campaign, tmp_path, form):
    if form == "text":
        again = load_campaign(write_manifest(campaign, tmp_path / "text"))
    else:
        write_campaign(campaign, tmp_path / "c.h5")
        again = load_campaign(tmp_path / "c.h5")
    assert again.machine == campaign.machine
    kept = replace(again.sets[0], source="", rows=None) if form == "text" else again.sets[0]
    assert_same_set(kept, campaign.sets[0])
    assert again.sets[0].options["nest_u"] == np.inf


def test_u_of_one_coordinate_is_kept_beside_a_key_for_the_others(campaign, tmp_path):
    """A plan: u of x stands in a column, that of y and z follows from a key once there are readings."""
    key = {"constant": 0.0004, "proportional": 0.001}
    plan = np.full_like(campaign.sets[0].readings, np.nan)
    u = np.stack([campaign.sets[0].u[:, 0], *[standard_uncertainty(key, plan[:, 0])] * 2], axis=1)
    planned = replace(campaign.sets[0], readings=plan, u=u, options=dict(campaign.sets[0].options) | {"u": key})
    made = replace(campaign, sets=(planned,))
    again = load_campaign(write_manifest(made, tmp_path / "plan"), plan=True).sets[0]
    np.testing.assert_array_equal(again.u, u)
    assert again.options == planned.options
    # measured: every u is a number again, whatever the key says
    measured = replace(planned, readings=campaign.sets[0].readings, u=campaign.sets[0].u)
    again = load_campaign(write_manifest(replace(campaign, sets=(measured,)), tmp_path / "measured")).sets[0]
    np.testing.assert_array_equal(again.u, campaign.sets[0].u)


def test_u_that_nothing_tells_cannot_be_written_as_text(campaign, tmp_path):
    u = campaign.sets[0].u.copy()
    u[3, 1] = np.nan
    with pytest.raises(OutputError, match="u of set 'R-test' is not known for every row"):
        write_manifest(replace(campaign, sets=(replace(campaign.sets[0], u=u),)), tmp_path / "text")


def test_one_sphere_and_one_tool_for_a_whole_set(campaign, tmp_path):
    path = write_manifest(campaign, tmp_path / "c")
    (path.parent / "R-test.csv").write_text("C,A,Y,X,Z,x,y,z\n0,0,0,0,0,0.1,0.2,0.3\n10,5,1,2,3,0.1,0.2,0.25\n")
    head = path.read_text(encoding="utf-8").split("[[set]]")[0]
    own = '[[set]]\nname = "R"\nkind = "displacement"\nfile = "R-test.csv"\n'
    path.write_text(head + own + "tool = [0, 0, -150]\nsphere = [1, 2, 3]\nu = 0.001\nu_z = 0.002\n", encoding="utf-8")
    read = load_campaign(path).sets[0]
    assert read.options["sphere"] == [1, 2, 3] and read.options["sensor_on"] == "tool" and read.options["range"] == 2.0
    np.testing.assert_array_equal(read.u, [[0.001, 0.001, 0.002]] * 2)
    np.testing.assert_array_equal(read.tool, [[0, 0, -150]] * 2)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('sensor_on = "tool"', 'sensor_on = "spindle"', r"sensor_on = 'spindle'; expected 'tool' or 'workpiece'"),
        ("P2 = [", "P9 = [", r"set 'R-test': sphere 'P2' has no approximate position; give sphere = \[x, y, z\] in mm"),
        ("P2 = [-79.0, ", "P2 = [", r"sphere 'P2' stands at \[91\.0, 61\.0\]; give sphere"),
        ("nest_u = inf", "nest_u = -1.0", r"nest_u is -1\.0; expected a finite number >= 0"),
        ("range = 1.5", 'range = "2 mm"', r"range is \"2 mm\"; expected a finite number"),
        ("range = 1.5", "ranges = 1.5", r"unknown key 'ranges'; did you mean 'range'"),
    ],
)
def test_bad_options(campaign, tmp_path, old, new, message):
    path = write_manifest(campaign, tmp_path / "c")
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load_campaign(path)


# ------------------------------------------------------------------------------------------------ what is checked


def spoilt(layout: str = "table C on A", **changes) -> Campaign:
    """A small R-test, fields of its set replaced by functions of the old value."""
    exact = exact_machine(LAYOUTS[layout])
    made = rtest(exact, rotary_truth(exact), n=(5, 3))
    return replace(made, sets=(replace(made.sets[0], **{k: f(getattr(made.sets[0], k)) for k, f in changes.items()}),))


def rotary(campaign: Campaign) -> np.ndarray:
    return np.array([not a.is_linear for a in campaign.machine.axes])


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_clean_rtest_has_no_warning_and_radians_are_an_error(layout):
    clean = spoilt(layout)
    assert check_campaign(clean) == ()
    letters = " and ".join(a for a in clean.machine.letters if a in "ABC")
    with pytest.raises(InputError, match=rf"R-test, set 'R-test': positions of {letters} seem to be in radians"):
        check_campaign(spoilt(layout, positions=lambda q: np.where(rotary(clean), np.deg2rad(q), q)))


def test_small_angles_are_no_radians():
    """A machine that really moved a few degrees, with a pivot that is 3 mm off."""
    exact = exact_machine(LAYOUTS["table C on A"])
    exact.travel.update(A=(-6.0, 6.0), C=(-6.0, 6.0))
    made = rtest(exact, rotary_truth(exact), n=(4, 4))
    wide = rtest(exact_machine(LAYOUTS["table C on A"]), rotary_truth(exact), n=(2, 2)).machine
    assert check_campaign(replace(made, machine=wide)) == ()


def test_an_axis_that_counts_the_other_way_is_named():
    clean = spoilt()
    wrong = spoilt(positions=lambda q: q * np.where(np.array(clean.machine.letters) == "C", -1.0, 1.0))
    (warning,) = check_campaign(wrong)
    assert "places of a sphere on the workpiece scatter by" in warning
    assert "with C counted the other way it is" in warning and "`direction` of [axis.C]" in warning


def test_a_sphere_outside_the_sensors_range():
    def shifted(d):
        d = d.copy()
        d[7, 2] = -2.5
        return d

    with pytest.raises(InputError, match=r"R-test, row 8: z = -2\.5 mm lies outside the sensor's range of ±2 mm"):
        check_campaign(spoilt(readings=shifted))
    assert not check_campaign(spoilt(readings=shifted, options=lambda o: dict(o) | {"range": 3.0}))


def test_probing_without_rotary_motion():
    def still(q):
        return np.where(rotary(spoilt()), np.where(np.arange(q.shape[1]) == 0, 90.0, -30.0), q)

    far = {"options": lambda o: dict(o) | {"range": 1e4}}
    with pytest.raises(InputError, match=r"C = 90°, A = -30° in every row; without rotary motion .*\"E\*C\" = false"):
        check_campaign(spoilt(positions=still, **far))
    one = spoilt(positions=lambda q: np.where(np.arange(q.shape[1]) == 1, -30.0, q), **far)
    assert not any("rotary motion" in w for w in check_campaign(one))  # C moves: the fit names what A lacks
