"""Malicious and damaged HDF5 files: one message within seconds, below 1 GB, nothing outside the file opened."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.damaged_hdf5 import MEMORY, Outcome, make_sources, run, tasks
from support.hdf5_files import changed, without_checksum
from support.places import DATASETS, SOURCE

import volid
from volid.exceptions import InputError
from volid.io.basics import hdf5_guard
from volid.io.basics.hdf5_seal import BLOCK, seal

HOSTILE = Path(__file__).parent / "hostile"
READ = """
import json, re, resource, sys, time
import volid
begin = time.perf_counter()
try:
    getattr(volid, sys.argv[1])(sys.argv[2])
    text = ""
except volid.VolidError as error:
    text = str(error)
seconds = time.perf_counter() - begin
# ru_maxrss of this process would hold what the tests' own process had when it started this one
with open("/proc/self/status") as status:
    own = int(re.search(r"VmHWM:\\s*(\\d+) kB", status.read())[1])
memory = 1024.0 * max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
print(json.dumps({"text": text, "seconds": seconds, "memory": memory}))
"""


def refused(function: str, path: Path) -> str:
    """The one message of a file that is refused within seconds and below 1 GB."""
    environment = os.environ | {"PYTHONPATH": str(SOURCE)}
    command = [sys.executable, "-c", READ, function, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["seconds"] < 10.0 and found["memory"] < MEMORY, found
    assert found["text"] and len(found["text"].splitlines()) == 1
    assert str(path) in found["text"]
    return found["text"]


@pytest.mark.parametrize(
    ("name", "function", "message"),
    [
        (
            "11_extstorage/extstorage_label.h5",
            "load_campaign",
            "/sets/1/labels/station: its values lie in another file",
        ),
        ("13_bomb/bomb_positions.h5", "load_campaign", "/sets/1/positions: its values would take 9600000000 bytes"),
        (
            "13_bomb/bomb_strlen.h5",
            "load_campaign",
            "/stations/name: texts have 1000000000 bytes each; expected at most",
        ),
        ("9_h5_malformed/compound.h5", "load_campaign", "/sets/1/positions: holds compound values; expected numbers"),
        ("9_h5_malformed/objref.h5", "load_campaign", "/sets/1/positions: holds references; expected numbers"),
        ("9_h5_malformed/softloop.h5", "load_campaign", "/sets is a soft link; expected the contents themselves"),
        ("9_h5_malformed/deepjson.h5", "load_campaign", "no valid JSON (nested too deeply)"),
        ("h5hang/g.h5", "load_grid", "the HDF5 file is truncated or damaged"),
    ],
)
def test_each_case_gives_its_message(name, function, message):
    found = refused(function, HOSTILE / name)
    assert message in found
    assert "root:" not in found  # a line of the system file that the case of external storage names


@pytest.fixture(scope="module")
def campaign_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("hostile") / "campaign.h5"
    volid.save_campaign(volid.load_campaign(DATASETS / "published_positioning" / "campaign.toml"), path)
    return path


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((7, 1), "f8")
    layout[...] = h5py.VirtualSource("/nowhere.h5", "x", (7, 1))
    del file["sets/1/readings"]
    file.create_virtual_dataset("sets/1/readings", layout)


def chunk_bomb(file: h5py.File) -> None:
    shape = file["sets/1/u"].shape
    del file["sets/1/u"]
    file.create_dataset("sets/1/u", shape, "f8", chunks=(2**28, 1), maxshape=(None, 1), compression="gzip")


def deep(file: h5py.File) -> None:
    group = file["sets"]
    for _ in range(1000):
        group = group.create_group("deeper")


def replace_by(name: str, link):
    def spoil(file: h5py.File) -> None:
        del file[name]
        file[name] = link(file)

    return spoil


@pytest.mark.parametrize("sealed", [False, True])
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (replace_by("sets/1", lambda f: h5py.ExternalLink("/etc/passwd", "/")), r"/sets/1 is a link to another file"),
        (replace_by("machine", lambda f: h5py.SoftLink("/stations/name")), r"/machine is a soft link"),
        (replace_by("stations", lambda f: f["sets"]), r"is a group that stands in several places"),
        (replace_by("sets/1", lambda f: f["/"]), r"is a group that stands in several places"),
        (replace_by("stations", lambda f: np.dtype("f8")), r"/stations is a named type"),
        (virtual, r"/sets/1/readings is a virtual dataset; expected its values in this file"),
        (chunk_bomb, r"/sets/1/u: a chunk has 2147483648 bytes; expected at most"),
        (deep, r"is deeper than 12 groups"),
        (lambda f: f.create_dataset("extra", (10**7,), "f8"), r"/extra: its values would take 80000000 bytes"),
        (
            lambda f: f.create_dataset("extra", (10**5,), "f8", chunks=(10,)),
            r"/extra: 0 chunks are stored; expected 10000",
        ),
        (lambda f: f.create_dataset("extra", data=np.ones(9, np.longdouble)), r"/extra: holds numbers of 16 bytes"),
        (lambda f: f.attrs.create("extra", f.ref, dtype=h5py.ref_dtype), r"/, attribute extra: holds references"),
        (lambda f: f["sets"].attrs.create("a\x1b[2J", 1.5 + 0j), r"/sets, attribute a.x1b\[2J: holds compound values"),
    ],
)
def test_what_leads_elsewhere_or_does_not_fit_is_refused(campaign_file, tmp_path, spoil, message, sealed):
    """Also where the checksum is right, so that no other process has looked at the file before."""
    path = tmp_path / "c.h5"
    path.write_bytes(campaign_file.read_bytes())
    with changed(path) as file:
        spoil(file)
    if sealed:
        path.write_bytes(bytes(BLOCK) + path.read_bytes())
        with path.open("r+b") as raw:
            seal(raw)
    with pytest.raises(InputError, match=message) as caught:
        volid.load_campaign(path)
    assert str(caught.value).startswith(f"{path}, /")


def test_a_file_without_checksum_is_read_as_before(campaign_file, tmp_path):
    path = tmp_path / "older.h5"
    path.write_bytes(campaign_file.read_bytes())
    before, after = volid.load_campaign(campaign_file), volid.load_campaign(without_checksum(path))
    for a, b in zip(before.sets, after.sets, strict=True):
        np.testing.assert_array_equal(a.readings, b.readings)
    assert before.machine == after.machine


def test_every_single_bit_is_noticed(campaign_file, tmp_path):
    """All bits of the first bytes and of every 37th byte after them, 12 of 1,500 of which once changed numbers."""
    whole, path = campaign_file.read_bytes(), tmp_path / "c.h5"
    places = [*range(0, BLOCK, 5), *range(BLOCK, len(whole), 397)]
    begin = time.perf_counter()
    for i in places:
        spoilt = bytearray(whole)
        spoilt[i] ^= 1 << i % 8
        path.write_bytes(spoilt)
        with pytest.raises(
            InputError, match=r"c\.h5: (the HDF5 file is truncated or damaged|not an HDF5 file|.*c\.h5)"
        ):
            volid.load_campaign(path)
    assert len(places) > 200 and time.perf_counter() - begin < 30.0


@pytest.mark.parametrize("content", ["number", "text", "attribute"])
def test_a_change_that_h5py_makes_is_noticed_and_can_be_meant(campaign_file, tmp_path, content):
    path = tmp_path / "c.h5"
    path.write_bytes(campaign_file.read_bytes())
    with h5py.File(path, "r+") as file:
        if content == "number":
            file["sets/1/readings"][0, 0] += 1e-4
        elif content == "text":
            file["stations/name"][...] = file["stations/name"][...]
            file["sets/1"].attrs["source"] = "other.csv"
        else:
            file.attrs["title"] = "another"
    with pytest.raises(
        InputError, match=r"its SHA-256 is not that in its first 512 bytes.*changed on purpose, cut off"
    ):
        volid.load_campaign(path)
    path.write_bytes(path.read_bytes()[512:])  # as the message says
    volid.load_campaign(path)


@pytest.mark.slow
def test_three_hundred_damaged_files(tmp_path):
    """A share of what `python -m benchmarks.damaged_hdf5 6000` does."""
    make_sources(tmp_path)
    found = list(run(tasks(300, seed=1), tmp_path))
    outcomes = [o for o in found if isinstance(o, Outcome)]
    assert len(outcomes) == 300
    assert [o for o in outcomes if o.result in ("traceback", "hang", "crash")] == []
    assert [o for o in outcomes if o.task.state == "checksum" and o.result == "changed"] == []
    assert all("\n" not in o.text for o in outcomes)
    assert max(o for o in found if not isinstance(o, Outcome)) < MEMORY
    assert sum(o.result == "refused" for o in outcomes) > 150  # what was done to them does damage


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("while True: pass", r"cannot be read within 1 s"),
        ("import resource; resource.setrlimit(resource.RLIMIT_CPU, (1, 1))\nwhile True: pass", r"works for more than"),
        ("import os; os.abort()", r"the HDF5 library fails on it"),
    ],
)
def test_a_library_that_hangs_or_dies_is_one_message(campaign_file, tmp_path, monkeypatch, program, message):
    """In the place of the program that reads first stands one that does what the HDF5 library does to damaged files."""
    path, reader = tmp_path / "older.h5", tmp_path / "reader.py"
    path.write_bytes(campaign_file.read_bytes())
    reader.write_text(program)
    monkeypatch.setattr(hdf5_guard, "READER", reader)
    monkeypatch.setattr(hdf5_guard, "SECONDS", 1)
    monkeypatch.setattr(hdf5_guard, "PATIENCE", 1 if "within" in message else 20)
    with pytest.raises(InputError, match=rf"older\.h5: the HDF5 file is truncated or damaged \(.*{message}"):
        volid.load_campaign(without_checksum(path))
