"""Levels: signs by the bodies that carry them, pairs of columns in any unit, and what their messages say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import ExactMachine, Truth
from exact_chain.instruments import Instruments, Virtual, measure
from support.kinds import machine_of, plan_set
from support.machines import volid_machine

from volid.campaign import Alignment, Campaign
from volid.exceptions import InputError
from volid.fitting.equations.interpreted import Interpreted
from volid.fitting.equations.problem import build_problem, scatter
from volid.fitting.fit import fit
from volid.io import load_campaign, write_campaign, write_manifest
from volid.model.error_functions import motion_names, spline_axes
from volid.model.error_model import build_model
from volid.observations import KINDS
from volid.observations.base import NuisanceTable

TRAVEL = {"X": (0.0, 600.0), "Y": (0.0, 400.0), "Z": (-300.0, 0.0)}
STRUCTURES = ["w X' Z' b Y t", "w b X Y Z t", "w X' Y' Z' b t", "w Y' b X Z t"]
TILTS = "\n".join(f'"{n}" = true' for n in ("EAX", "EBX", "EAY", "EBY", "EAZ", "EBZ"))
ONLY_TILTS = f'[model]\nsegments = 2\n[model.functions]\n"*" = false\n{TILTS}\n'
N = 7


def plan(machine, **options) -> Campaign:
    """A and B along every axis, Z vertical."""
    sets = []
    for axis in "XYZ":
        i = machine.index(axis)
        q = np.tile([0.5 * sum(a.travel) for a in machine.axes], (2 * N, 1))
        q[:, i] = np.tile(np.linspace(*machine.axes[i].travel, N), 2)
        labels = {"component": np.repeat(["A", "B"], N), "line": axis}
        sets.append(plan_set(f"levels {axis}", "level", q, np.zeros(3), labels, u=1e-6, vertical="Z", **options))
    sets = [replace(s, time=None, temperature=None, options={**s.options, "u": 1e-6}) for s in sets]
    return Campaign(machine, (), tuple(sets))


def straight(size: float):
    """A function that grows by `size` over 600 mm."""
    return lambda q: size * np.asarray(q) / 600.0


@pytest.mark.parametrize("structure", STRUCTURES)
def test_signs_follow_from_the_bodies_on_every_structure(structure, tmp_path):
    """Levels against gravity on the exact chain, noiseless, through moving and reference columns: rolls and pitches come back."""
    exact = ExactMachine(structure, TRAVEL)
    names = ("EAX", "EBX", "EAY", "EBY", "EAZ", "EBZ")
    truth = Truth({name: straight((-1) ** k * (20 + 10 * k) * 1e-6) for k, name in enumerate(names)})
    machine = volid_machine(exact, ONLY_TILTS)
    write_manifest(plan(machine), tmp_path / "c")
    campaign = load_campaign(
        measure(tmp_path / "c", Virtual(exact, truth, Instruments(np.random.default_rng(3))), None)
    )
    assert "moving,reference" in (tmp_path / "c" / "levels_X.csv").read_text()
    solution = fit(campaign)
    for name in names:
        own = [f for f in solution.functions(points=2) if f.name == name]
        rise = own[1].value - own[0].value
        low, high = TRAVEL[name[2]]
        assert rise == pytest.approx(float(truth.functions[name](high) - truth.functions[name](low)), abs=2e-8), name


def test_a_level_on_a_carriage_sees_what_lies_between_it_and_the_bed():
    """Y' moves: the carriage of X, on the other side of the bed, does not turn against it; the table does, by EAY alone."""
    machine = machine_of(
        """format = "volid-machine/1"\nname = "m"\nstructure = "w Y' b X Z t"\n[axis.X]\ntravel = [0.0, 600.0]
[axis.Y]\ntravel = [0.0, 400.0]\n[axis.Z]\ntravel = [-300.0, 0.0]\n[model]\nsegments = 1\ndegree = 1\n"""
    )
    model = build_model(machine, {n: (1,) * len(spline_axes(machine, n)) for n in motion_names(machine)})
    theta = np.zeros(model.n_parameters)

    def readings(**options):
        campaign = plan(machine, **options)
        campaign = replace(campaign, sets=campaign.sets[1:2])  # Y moves
        problem = build_problem(campaign, model, engine=Interpreted())
        rows = []
        for j in range(len(theta)):
            step = theta.copy()
            step[j] = 1e-6
            z = np.concatenate([problem.model.parametrisation @ step, np.zeros(len(problem.nuisance))])
            (found,) = scatter(problem, campaign, problem.equations.predictions(z))
            rows.append(np.ptp(found[:N, 0]))
        return dict(zip(model.parameter_labels(), rows, strict=True))

    def moved_by(found):
        return {label.split("[")[0] for label, rise in found.items() if rise > 1e-8}

    assert moved_by(readings(moving_on="X", reference_on="bed")) == set()
    assert moved_by(readings(moving_on="Y", reference_on="bed")) == {"EAY"}
    assert moved_by(readings()) == {"EAY"}


# ----------------------------------------------------------------------------------------------------------- files

MACHINE = """format = "volid-machine/1"\nname = "m"\nstructure = "w X' Z' b Y t"
[axis.X]\ntravel = [0.0, 600.0]\n[axis.Y]\ntravel = [0.0, 400.0]\n[axis.Z]\ntravel = [0.0, 300.0]\n"""
MANIFEST = """format = "volid-campaign/1"\nmachine = "machine.toml"
[[set]]\nname = "levels"\nkind = "component"\nfile = "levels.csv"\nvertical = "Y"\nu = 1e-6\n"""
ROWS = "X,Y,Z,component,moving,reference\n" + "\n".join(
    f"{x},0,0,A,{10 + x / 100},{2 - x / 100}" for x in (0, 300, 600)
)


def campaign_of(folder, manifest=MANIFEST, rows=ROWS):
    folder.mkdir(exist_ok=True)
    (folder / "machine.toml").write_text(MACHINE)
    (folder / "campaign.toml").write_text(manifest)
    (folder / "levels.csv").write_text(rows)
    return load_campaign(folder / "campaign.toml")


@pytest.mark.parametrize(("unit", "size"), [("µm/m", 1e-6), ("arcsec", np.pi / 648000.0), ("mrad", 1e-3)])
def test_two_columns_in_a_component_set_are_levels_in_the_unit_that_is_stated(unit, size, tmp_path):
    units = f'[set.csv]\nunits = {{ moving = "{unit}", reference = "{unit}" }}\n'
    (own,) = campaign_of(tmp_path, MANIFEST + units).sets
    assert own.kind == "level"
    np.testing.assert_allclose(own.readings[:, 0], np.array([8.0, 14.0, 20.0]) * size, rtol=1e-12)


def test_the_pair_is_kept_as_their_difference_in_both_forms_of_file(tmp_path):
    units = '[set.csv]\nunits = { moving = "µm/m", reference = "µm/m" }\n'
    found = campaign_of(tmp_path / "a", MANIFEST + units)
    write_campaign(found, tmp_path / "c.h5")
    for again in (load_campaign(tmp_path / "c.h5"), load_campaign(write_manifest(found, tmp_path / "b"))):
        assert again.sets[0].kind == "level" and again.sets[0].options["vertical"] == "Y"
        np.testing.assert_array_equal(again.sets[0].readings, found.sets[0].readings)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('vertical = "Y"\n', "", "vertical"),
        ('vertical = "Y"', 'vertical = "C"', "vertical is 'C'; expected the axis that is vertical"),
        (
            'vertical = "Y"',
            'vertical = "X"',
            r"levels.csv, row 2: component A is a turn about the vertical, X, which no level",
        ),
        ("u = 1e-6", 'u = 1e-6\noffset_per = "day"', "offset_per is 'day'; expected \"line\""),
        ("u = 1e-6", "u = 1e-6\nslope = true", "slope"),
    ],
)
def test_what_does_not_fit_a_pair_of_levels_is_named(old, new, said, tmp_path):
    units = '[set.csv]\nunits = { moving = "µm/m", reference = "µm/m" }\n'
    with pytest.raises(InputError, match=said):
        campaign_of(tmp_path, MANIFEST.replace(old, new) + units)


def test_a_single_column_of_a_pair_names_the_other(tmp_path):
    rows = "X,Y,Z,component,moving\n0,0,0,A,1e-6\n300,0,0,A,2e-6\n"
    with pytest.raises(InputError, match=r"levels\.csv.*reference"):
        campaign_of(tmp_path, rows=rows)


def group(own, machine):
    return KINDS["level"].groups(own, Campaign(machine, (), (own,), alignments=(Alignment("square"),)), NuisanceTable())


def test_bodies_that_cannot_be_are_named():
    machine = volid_machine(ExactMachine("w X' Z' b Y t", TRAVEL))
    (own, *_) = plan(machine).sets
    still = replace(own, positions=np.tile(own.positions[:1], (len(own.positions), 1)))
    both = replace(own, positions=own.positions + np.linspace(0, 1, 2 * N)[:, None])
    elsewhere = replace(own, labels={**own.labels, "placement": np.full(2 * N, "sqare")})
    alike = replace(own, options={**own.options, "moving_on": "Z", "reference_on": "Z"})
    unknown = replace(own, options={**own.options, "moving_on": "table"})
    for wrong, said in (
        (still, "no axis moves along the line, so that it is open which level moves; state moving_on"),
        (both, "axes of the workpiece side and of the tool side move along the line"),
        (elsewhere, r"placement 'sqare' is no \[\[alignment\]\]; there are square"),
        (alike, r"both levels stand on one body \(Z\)"),
        (unknown, "moving_on is 'table'; expected one of workpiece, bed, tool, X, Z, Y"),
    ):
        with pytest.raises(InputError, match=said):
            group(wrong, machine)
