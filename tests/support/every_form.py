"""One campaign with every form of set: stations of several bodies, a network, absolute and calibrated lengths, components."""

from functools import cache

import numpy as np
from exact_chain import ExactMachine

from support.machines import volid_machine
from volid.campaign import Alignment, Campaign, End, ObservationSet, Station
from volid.fitting.equations.problem import build_problem
from volid.model.error_functions import motion_names, spline_axes
from volid.model.error_model import LOCATION, build_model

EXACT = ExactMachine("w Y' b X Z (C) t", {"X": (0, 1000), "Y": (0, 600), "Z": (-500, 0)})
EXTRA = """[model.functions]
EXX = { reversal = true }
EYY = { reversal = "constant" }
EAZ = { over = ["Z", "X"] }
"""
M = 25
STATIONS = {
    "free": Station("free", position=(-100.0, -200.0, -700.0)),
    "bed": Station("bed", body="bed", position=(1200.0, -300.0, -600.0)),
    "column": Station("column", body="X", position=(-500.0, 900.0, -100.0)),
    "exact": Station("exact", position=(1300.0, 800.0, 300.0), known=True, frame="machine"),
    "net1": Station("net1", position=(-100.0, 50.0, 20.0), known=True),
    "net2": Station("net2", position=(1100.0, 0.0, 80.0), known=True),
}
# every form of set: stations of several bodies in one, a network, absolute and calibrated lengths
SETS = {
    "relative": dict(stations=["free", "bed", "column", "exact", "net1"]),
    "absolute": dict(stations=["net2", "free"], relative=False),
    "calibrated": dict(stations=["bed"], relative=False, calibrated_u=0.001),
}


def observations(name, rng, kind="distance", k=1, **fields):
    way = rng.choice([-1.0, 1.0], (M, 3))
    return ObservationSet(
        name,
        kind,
        positions=rng.uniform([0, 0, -500], [600, 1000, 0], (M, 3)),
        directions=way,
        tool=rng.uniform(-200, 200, (M, 3)),
        readings=rng.uniform(400, 900, (M, k)) if kind == "distance" else rng.normal(size=(M, k)) * 1e-2,
        u=rng.uniform(3e-4, 2e-3, (M, k)),
        **fields,
    )


def distances(name, rng, stations, relative=True, calibrated_u=0.0):
    i = np.arange(M)
    labels = {"station": np.array(stations)[i % len(stations)], "segment": np.where(i < 12, "1", "2")}
    return observations(name, rng, labels=labels, options={"relative": relative, "calibrated_u": calibrated_u})


def components(rng, letters, slope):
    labels = {"component": np.array(list(letters))[np.arange(M) % 2], "line": np.where(np.arange(M) < 12, "1", "2")}
    return observations(f"components {letters}", rng, "component", labels=labels, options={"slope": slope})


def lengths(rng):
    """Between two places and two tool vectors each; offset and scale of two artefacts unknown."""
    to = End(
        rng.uniform([0, 0, -500], [600, 1000, 0], (M, 3)),
        rng.choice([-1.0, 1.0], (M, 3)),
        rng.uniform(-200, 200, (M, 3)),
    )
    labels = {"artefact": np.where(np.arange(M) < 12, "bar", "gauge")}
    return observations("lengths", rng, "length", labels=labels, options={"relative": True, "scale_u": np.inf}, to=to)


def legs(rng):
    """Two legs of a square with an angle and a form of its own, placed as a whole."""
    lines = {"X": {"along": [1, 0, 0], "normal": [0, 1, 0]}, "Y": {"along": [0, 1, 0], "normal": [1, 0, 0]}}
    labels = {"line": np.where(np.arange(M) < 12, "X", "Y"), "component": np.where(np.arange(M) < 12, "Y", "X")}
    options = {"alignment": "square", "lines": lines, "form_u": 1e-3, "angle_u": 1e-5, "offset": False}
    return observations("legs", rng, "component", labels=labels, options=options)


@cache
def everything():
    """One campaign with every form of set, its problem, and z where nothing is zero."""
    rng = np.random.default_rng(0)
    sets = [distances(name, rng, **form) for name, form in SETS.items()]
    sets += [components(rng, "XC", False), components(rng, "YA", True), lengths(rng), legs(rng)]
    machine = volid_machine(EXACT, EXTRA)
    campaign = Campaign(machine, tuple(STATIONS.values()), tuple(sets), alignments=(Alignment("square"),))
    segments = {n: (3, 2)[: len(spline_axes(machine, n))] for n in motion_names(machine)}
    built = build_problem(campaign, build_model(machine, segments))
    terms = built.model.layout.terms
    units = {"mm": 3.0, "rad": 1e-3, "mm/mm": 1e-4, "rad/mm": 1e-6, "1": 1e-4}
    scale = np.concatenate(
        [np.full(t.basis.size, 1e-2 if t.part != LOCATION and t.name[1] in "XYZ" else 1e-4) for t in terms]
        + [[units[e.unit]] for e in built.nuisance]
    )
    return campaign, built, built.start + scale * rng.normal(size=len(scale)), scale
