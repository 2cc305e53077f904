"""A kind of observation and a type of effect that only tests know: the whole path works without a line of them in `src`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.kinds import THREE, TOOLS, distances, exact_truth, machine_of, plan_set, positions_of, predictions

from volid.backend.elementary import in_rows
from volid.campaign import Campaign, Effect
from volid.effects import TYPES, EffectType
from volid.effects.base import FileKey, Number, Term, slots_of
from volid.exceptions import InputError
from volid.fitting.diagnosis.statements import likely_reasons
from volid.fitting.fit import fit
from volid.io import load_campaign, write_campaign, write_manifest
from volid.io.solutions import read_solution, write_solution
from volid.model.kinematics import functional_point, nominal_point
from volid.model.machine import Datum
from volid.observations import KINDS, Kind
from volid.observations.base import Group
from volid.observations.response import Linear
from volid.plausibility.checks import check_campaign
from volid.report.text.summary import summary, summary_data
from volid.virtual.simulate import simulate

DATUM = Datum("Z", "X", "end_point")


class Flat(Kind):
    """Distance of the functional point from a flat on the workpiece: z + a x + b y + c, its attitude and height unknown."""

    name = "flat"
    readings = ("gap",)
    doc = "z + a x + b y + c of the functional point [mm]"
    labels: Mapping[str, str | None] = {"flat": "1"}
    options: Mapping[str, Any] = {"reach": 500.0}
    scopes: Mapping[str, tuple[str, ...]] = {"flat": ("flat",)}
    tested_by = named_by = ("flat",)

    @staticmethod
    def predict(machine, settings, q, tool, errors, slots, constants):
        x, y, z = functional_point(machine, q, tool, errors)
        return in_rows([z + slots[0] * x + slots[1] * y + slots[2]], np.shape(q[0]))

    def groups(self, observations, campaign, table):
        slots = np.zeros((3, len(observations)), dtype=np.int64)
        for name in dict.fromkeys(observations.labels["flat"].tolist()):
            rows = observations.labels["flat"] == name
            for i, (what, unit, spread) in enumerate((("a", "1", 1e-3), ("b", "1", 1e-3), ("c", "mm", 1.0))):
                answer = np.zeros(9)  # c + t_z, a - ω_y, b + ω_x
                answer[(4, 3, 2)[i]] = (1.0, -1.0, -1.0)[i]
                number = table.index(
                    ("flat", name, what),
                    f"flat {name} {what}",
                    unit,
                    spread=spread,
                    response=Linear(constant=tuple(answer.tolist())),
                )
                slots[i, rows] = number
        return [Group(np.arange(len(observations)), None, slots, np.zeros((0, len(observations))))]

    def starts(self, campaign):
        found = {}
        for s in campaign.sets:
            points = nominal_point(campaign.machine, s.positions, s.tool)
            for name in dict.fromkeys(s.labels["flat"].tolist()) if s.kind == self.name else ():
                own = s.labels["flat"] == name
                design = np.column_stack([points[own, :2], np.ones(own.sum())])
                plane = np.linalg.lstsq(design, s.readings[own, 0] - points[own, 2], rcond=None)[0]
                found.update({("flat", name, c): float(v) for c, v in zip("abc", plane, strict=True)})
        return found

    def check_values(self, observations, campaign):
        if np.ptp(observations.readings) > 2.0 * observations.options["reach"]:
            raise InputError(f"set '{observations.name}': gaps seem to be in micrometres; expected mm")

    def advice(self, sets, campaign):
        return ["a flat was probed; use two that are not parallel"]


class Warp(EffectType):
    """The reading changes with the square of the first axis's position [m], by an unknown per scope."""

    name = "warp"
    keys: Mapping[str, FileKey] = {"power": Number(least=1.0)}

    def terms(self, effect, observations, campaign, table):
        factor = (1e-3 * observations.positions[:, :1]) ** effect.options.get("power", 2.0)
        return [Term(np.tile(factor, (1, observations.readings.shape[1])), slots_of(observations, effect, table, "mm"))]

    def variance(self, effect, observations, machine, sensitivity):
        return (effect.u * (1e-3 * observations.positions[:, :1]) ** 2) ** 2 * np.ones(observations.readings.shape)


@pytest.fixture
def toys(monkeypatch):
    monkeypatch.setitem(KINDS, "flat", Flat())
    monkeypatch.setitem(TYPES, "warp", Warp())


def plan(**changes) -> Campaign:
    machine = machine_of(THREE)
    stations, volume = distances(machine, 60)
    q = positions_of(machine, 60, seed=8)
    labels = {"flat": np.where(np.arange(60) < 30, "top", "step")}
    own = plan_set("probed", "flat", q, TOOLS[np.arange(60) % 3], labels)
    effects = (Effect("bow", "warp", 2e-3, "flat", {"power": 2.0}), Effect("noise", "warp", 1e-4, "point", {}))
    return Campaign(machine, stations, (volume, replace(own, effects=effects, **changes)), title="toys")


def test_the_whole_path_but_monte_carlo(toys, tmp_path):
    there = load_campaign(write_manifest(plan(), tmp_path / "plan"), plan=True)
    campaign, truth = simulate(there, exact_truth(there.machine), seed=3, station_error=2.0)
    assert {"flat top a", "flat step c", "bow top", "bow step"} <= set(truth.instruments)
    write_campaign(campaign, tmp_path / "c.h5")
    campaign = load_campaign(tmp_path / "c.h5")
    assert campaign.sets[1].kind == "flat" and campaign.sets[1].effects[0].options == {"power": 2.0}
    assert check_campaign(campaign) == ()
    solution = fit(campaign)
    assert not solution.adequacy.rejected, solution.adequacy.verdict
    n = solution.model.n_parameters
    for i, entry in enumerate(solution.nuisance_table):
        if entry.name in truth.instruments and entry.effect == "bow":
            u = float(np.sqrt(solution.covariance[n + i, n + i]))
            assert abs(float(solution.nuisance[i]) - truth.instruments[entry.name]) < 4.0 * u < 4.0 * 2e-3
    write_solution(solution, tmp_path / "s.h5")
    moved = read_solution(tmp_path / "s.h5").in_datum(DATUM)
    assert np.abs(np.asarray(moved.nuisance) - np.asarray(solution.nuisance)).max() > 1e-4
    for one, other in zip(predictions(solution), predictions(moved), strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-5)  # a slope of 1e-3, a shift of 5 µm
    rows = {row["set"]: row for row in summary_data(solution)["sets"]}
    assert rows["probed"]["kind"] == "flat" and rows["probed"]["unit"] == "mm"
    assert "probed" in summary(solution) and "flat top" in {g.what for g in solution.adequacy.groups}


def test_its_units_scopes_and_advice_are_asked_for(toys, tmp_path):
    campaign, _ = simulate(plan(), exact_truth(machine_of(THREE)), seed=3, station_error=2.0)
    own = campaign.sets[1]
    with pytest.raises(InputError, match="set 'probed': gaps seem to be in micrometres"):
        check_campaign(replace(campaign, sets=(campaign.sets[0], replace(own, readings=1e3 * own.readings))))
    path = write_manifest(campaign, tmp_path / "c")
    path.write_text(path.read_text().replace('per = "flat"', 'per = "station"'))
    with pytest.raises(InputError, match=r"a 'flat' set has no stations; expected campaign, set, flat, tool or point"):
        load_campaign(path)
    assert likely_reasons(campaign)[0] == "in set 'probed': a flat was probed; use two that are not parallel"


@pytest.mark.slow
def test_monte_carlo_of_toys(toys):
    from volid.uncertainty.trials.monte_carlo import monte_carlo

    campaign, _ = simulate(plan(), exact_truth(machine_of(THREE)), seed=3, station_error=2.0)
    solution = monte_carlo(fit(campaign), 2000, seed=1)
    names = [e.name for e in solution.nuisance_table]
    n, own = solution.model.n_parameters, [names.index("flat top a"), names.index("bow step")]
    x = np.concatenate(list(solution.samples.batches()))[:, n + np.array(own)]
    expected = np.sqrt(np.diagonal(solution.covariance))[n + np.array(own)]
    np.testing.assert_allclose(x.std(axis=0), expected, rtol=0.1)  # 2000 trials: 1.6 %, four of that and more


def test_the_trials_of_toys_predict_the_same_in_another_datum(toys):
    from volid.uncertainty.trials.monte_carlo import monte_carlo

    campaign, _ = simulate(plan(), exact_truth(machine_of(THREE)), seed=3, station_error=2.0)
    solution = monte_carlo(fit(campaign), 20, seed=1)
    moved = solution.in_datum(DATUM)
    before, after = (next(s.samples.batches())[:5] for s in (solution, moved))
    assert np.abs(after - before)[:, solution.model.n_parameters :].max() > 1e-4, "nothing to follow"
    for one, other in zip(predictions(solution, before), predictions(moved, after), strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-5)  # a slope of 1e-3, a shift of 5 µm
