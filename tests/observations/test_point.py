"""Points in the frame of a station: readings of the exact chain, the station's pose from them, files, a fit, bad input."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from exact_chain import COMPONENTS
from scipy.spatial.transform import Rotation
from support.judging import judge
from support.machines import LAYOUTS, VERTICAL, exact_machine, fixed
from support.points import PLACE, TURN, points
from support.rtests import small_rotation
from support.sets import assert_same_set

from volid.campaign import Station
from volid.exceptions import InputError
from volid.fitting.fit import fit
from volid.io import load_campaign, write_manifest
from volid.observations import KINDS
from volid.observations.base import NuisanceTable
from volid.virtual.simulate import simulate


@pytest.mark.parametrize("body", ["workpiece", "bed"])
@pytest.mark.parametrize("layout", ["table C on A", "split C and B", "fork C A"])
def test_points_are_those_of_the_exact_chain(layout, body):
    exact = exact_machine(LAYOUTS[layout])
    campaign, truth = points(exact, 40, body)
    readings, table = campaign.sets[0], NuisanceTable()
    (group,) = KINDS["point"].groups(readings, campaign, table)
    found = np.array(group.settings.rotation).reshape(3, 3)
    start = {e.name: e.start for e in table.entries}
    assert np.linalg.norm(Rotation.from_matrix(found.T @ TURN).as_rotvec()) < 2e-3  # the machine's errors, in rad
    np.testing.assert_allclose([start[f"station T {c}"] for c in "XYZ"], PLACE, atol=1.5)
    small = Rotation.from_matrix(TURN @ found.T).as_rotvec()
    true = {f"station T {c}": x for c, x in zip("XYZ", PLACE, strict=True)}
    true |= {f"orientation T {c}": x for c, x in zip("ABC", small, strict=True)}
    values = np.array([true[e.name] for e in table.entries])
    spindle = np.tile([truth.constants.get(f"{c}0S", 0.0) for c in COMPONENTS], (len(readings), 1))
    errors = np.hstack([*(exact.errors(a, readings.positions, truth) for a in exact.axes), spindle])
    arrays = (jnp.asarray(readings.positions.T), tuple(jnp.asarray(readings.tool.T)), jnp.asarray(errors.T))
    predicted = KINDS["point"].predict(
        campaign.machine, group.settings, *arrays, jnp.asarray(values[group.slots]), None
    )
    np.testing.assert_allclose(
        np.asarray(predicted).T, readings.readings, rtol=0, atol=1e-6 + 2e3 * np.abs(small).max() ** 3
    )
    assert np.allclose(small_rotation(small), TURN @ found.T)


def test_one_tracker_in_any_pose_gives_the_volume():
    campaign, truth = points(VERTICAL, 150, u=0.001, model=fixed(4))
    solution = fit(campaign)
    assert solution.statements == ()
    assert judge(solution, VERTICAL, truth).rms < 0.003


def test_a_plan_is_simulated_and_files_lose_nothing(tmp_path):
    campaign, _ = points(VERTICAL, 30)
    empty = replace(campaign.sets[0], readings=np.full_like(campaign.sets[0].readings, np.nan))
    station = Station("T", position=tuple(PLACE.tolist()))
    measured, truth = simulate(replace(campaign, stations=(station,), sets=(empty,)), seed=3, noise=False)
    assert truth.stations["T"] == tuple(PLACE.tolist())
    assert 0 < abs(truth.instruments["orientation T B"]) <= 1e-3
    (group,) = KINDS["point"].groups(measured.sets[0], measured, NuisanceTable())
    assert np.abs(np.array(group.settings.rotation).reshape(3, 3) - np.eye(3)).max() < 2e-3
    again = load_campaign(write_manifest(measured, tmp_path / "c"))
    assert_same_set(replace(again.sets[0], source="", rows=None), measured.sets[0])


def test_points_on_one_line():
    campaign, _ = points(VERTICAL, 20)
    q = np.linspace([0, 0, 0], [1, 1, 1], 20) * np.array([300.0, 200.0, -100.0])
    line = replace(campaign.sets[0], positions=q, tool=np.zeros((20, 3)), readings=q, u=np.full((20, 3), 0.001),
                   directions=np.zeros((20, 3)), labels={"station": np.full(20, "T")})  # fmt: skip
    with pytest.raises(InputError, match="station 'T': its 20 points lie on one line; its orientation needs three"):
        KINDS["point"].groups(line, replace(campaign, sets=(line,)), NuisanceTable())
