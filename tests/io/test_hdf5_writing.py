"""HDF5 files on a full disk: one message, nothing left, and the process lives; what is written carries its checksum."""

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest
from support.places import DATASETS, SOURCE

import volid
from volid.cli import main
from volid.exceptions import InputError, OutputError
from volid.io.basics import hdf5_guard
from volid.io.basics.hdf5_writing import hdf5_output
from volid.io.simulations import write_simulation

CAMPAIGN = DATASETS / "published_positioning" / "campaign.toml"
# Writes every sort of file while no file may have more than so many bytes, which gives an error like that of a full disk
FULL = """
import json, resource, sys
from pathlib import Path
import volid
from volid.io.truths import write_truth
from volid.io.study_results import places, write_results
folder, campaign = Path(sys.argv[1]), volid.load_campaign(sys.argv[2])
solution = volid.fit(campaign)
grid = volid.linear_grid(solution, points=11, tool=(0.0, 0.0, 0.0))
truth = volid.random_truth(campaign.machine, 1)
found = {}
for limit in (0, 100, 600, 3000, 9000, 20_000, 50_000, 100_000, 200_000, 10**9):
    for name, write in {
        "campaign": lambda p: volid.save_campaign(campaign, p),
        "solution": lambda p: volid.save_solution(solution, p),
        "grid": lambda p: volid.save_grid(grid, solution, p),
        "truth": lambda p: write_truth(truth, p),
        "study": lambda p: write_results(places(p), [], [], {"a": "b" * 500_000}),
    }.items():
        path = folder / f"{name}{limit}.h5"
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        try:
            write(path)
            text = ""
        except volid.OutputError as error:
            text = str(error)
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        found[path.name] = text
print(json.dumps(found))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit of the system")
def test_a_full_disk_is_one_message_and_leaves_nothing(tmp_path):
    environment = os.environ | {"PYTHONPATH": str(SOURCE)}
    command = [sys.executable, "-W", "ignore", "-c", FULL, str(tmp_path), str(CAMPAIGN)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    refused = [name for name, text in found.items() if text]
    assert all(f"{name} cannot be written: File too large" in found[name] for name in refused)
    assert len(refused) > 25 and {name for name in found if name.endswith("1000000000.h5")}.isdisjoint(refused)
    assert {p.name for p in tmp_path.glob("*.h5")} | {p.name for p in tmp_path.glob(".*")} == found.keys() - set(
        refused
    )


def test_the_first_bytes_state_number_and_sha256_of_the_others(tmp_path):
    volid.save_campaign(volid.load_campaign(CAMPAIGN), tmp_path / "c.h5")
    data = (tmp_path / "c.h5").read_bytes()
    lines = data[:512].decode("ascii").split("\n")
    assert lines[0].startswith("volid: HDF5")
    assert lines[1:3] == [f"bytes: {len(data) - 512}", f"sha256: {hashlib.sha256(data[512:]).hexdigest()}"]
    assert h5py.is_hdf5(tmp_path / "c.h5")
    with h5py.File(tmp_path / "c.h5") as file:
        assert file.userblock_size == 512


def test_an_error_of_the_one_who_writes_is_not_covered(tmp_path):
    with pytest.raises(ZeroDivisionError), hdf5_output(tmp_path / "c.h5") as file:
        file["x"] = 1 / 0
    with pytest.raises(ValueError, match="mine"), hdf5_output(tmp_path / "c.h5"):
        raise ValueError("mine")
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_held_against_its_checksum_once(tmp_path, monkeypatch):
    """While it stays as it is; what has changed only now is looked at again each time."""
    path, calls = tmp_path / "c.h5", []
    volid.save_campaign(volid.load_campaign(CAMPAIGN), path)
    check = hdf5_guard.check_seal
    monkeypatch.setattr(hdf5_guard, "check_seal", lambda p: calls.append(p) or check(p))
    volid.load_campaign(path)
    volid.load_campaign(path)
    assert len(calls) == 2
    monkeypatch.setattr(hdf5_guard, "_SETTLED", -1.0)
    volid.load_campaign(path)
    volid.load_campaign(path)
    assert len(calls) == 3


# ---------------------------------------------------------------------------------------------- texts that HDF5 cannot hold


@pytest.mark.parametrize("what", ["title", "station", "set", "effect", "label", "machine"])
def test_the_character_0_is_refused_before_the_work(what):
    campaign = volid.load_campaign(DATASETS / "vertical_multilateration" / "campaign.toml")
    readings, station = campaign.sets[0], campaign.stations[0]
    labels = {"segment": np.array(["a\0b"] * len(readings))}
    wrong = {
        "title": lambda: replace(campaign, title="a\0b"),
        "station": lambda: replace(campaign, stations=(replace(station, name="S1\0"),)),
        "set": lambda: replace(campaign, sets=(replace(readings, name="\0a"),)),
        "effect": lambda: replace(campaign, sets=(replace(readings, effects=(volid_effect("e\0"),)),)),
        "label": lambda: replace(campaign, sets=(replace(readings, labels={**readings.labels, **labels}),)),
        "machine": lambda: replace(campaign, machine=replace(campaign.machine, name="m\0")),
    }[what]()
    from volid.io.campaign.rules import check_consistent

    with pytest.raises(InputError, match=rf"campaign\.toml: the .*{what}.* is .*u0000.*without the character U\+0000"):
        check_consistent(wrong)


def volid_effect(name):
    from volid.campaign import Effect

    return Effect(name, "scale", 1e-6, "set")


def test_the_character_0_in_a_text_of_ones_own_is_an_output_error(tmp_path):
    campaign = replace(volid.load_campaign(CAMPAIGN), title="a\0b")
    with pytest.raises(OutputError, match=r"c\.h5 cannot be written: a text holds the character U\+0000"):
        volid.save_campaign(campaign, tmp_path / "c.h5")
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------------------------------------- campaign and truth, or none


@pytest.mark.parametrize("name", ["new/campaign.toml", "campaign.h5"])
def test_no_half_pair(tmp_path, monkeypatch, name):
    campaign = volid.load_campaign(CAMPAIGN)
    truth = volid.random_truth(campaign.machine, 1)
    path = tmp_path / name
    bad = replace(truth, source="a\0b")
    with pytest.raises(OutputError, match=rf"{path.parent.name}/x\.truth\.h5 cannot be written: a text holds"):
        write_simulation(campaign, bad, path, path.with_name("x.truth.h5"))
    assert list(tmp_path.iterdir()) == []
    write_simulation(campaign, truth, path, path.with_name("x.truth.h5"))
    assert volid.load_campaign(path).n_readings == campaign.n_readings
    before = {p: p.read_bytes() for p in path.parent.iterdir()}
    with pytest.raises(OutputError, match=r"cannot be written"):
        write_simulation(replace(campaign, title="b"), bad, path, path.with_name("x.truth.h5"), overwrite=True)
    assert {p: p.read_bytes() for p in path.parent.iterdir()} == before


def test_simulate_refuses_when_one_of_the_two_is_there(tmp_path, capsys):
    (tmp_path / "c.truth.h5").write_text("kept")
    plan = DATASETS / "vertical_multilateration" / "campaign.toml"
    machine = DATASETS / "vertical_multilateration" / "machine.toml"
    assert main(["simulate", str(machine), "--plan", str(plan), "-o", str(tmp_path / "c.h5")]) == 2
    assert "c.truth.h5 exists" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["c.truth.h5"]
