"""Campaigns in HDF5: nothing is lost, plain h5py reads them, what is wrong is told; several files are merged."""

from dataclasses import fields, replace

import h5py
import numpy as np
import pytest
from support.campaign_files import MACHINE, MANIFEST, csv_text, level_rows, volume_rows, write_files
from support.hdf5_files import changed
from support.sets import assert_same_set

from volid.campaign import Campaign, Effect, Station
from volid.exceptions import InputError, OutputError
from volid.io import load_campaign, read_campaign, read_manifest, write_campaign


@pytest.fixture
def campaign(tmp_path) -> Campaign:
    """A campaign that uses everything a file can hold."""
    rows = volume_rows() | {"temperature": ["", *[20.25] * 53], "time": [0.1 * i for i in range(54)]}
    read = read_manifest(write_files(tmp_path / "text", volume=csv_text(rows)))
    volume = replace(
        read.sets[0],
        labels=read.sets[0].labels | {"segment": np.array(["Strahl ä"] * 50 + ["µ"] * 4)},
        options=dict(read.sets[0].options) | {"lines": {"D1": [0.1, 0.2, np.pi]}},
        effects=(*read.sets[0].effects, Effect("tool length", "tool_length", 0.0015, "set")),
    )
    return replace(
        read,
        stations=(*read.stations, Station("S3", body="bed")),
        sets=(volume, *read.sets[1:]),
        conditions=dict(read.conditions) | {"nested": {"list": [1, 2.5, {"a": True}], "text": "20 °C"}},
        warnings=("warm-up was short",),
    )


@pytest.fixture
def path(campaign, tmp_path):
    write_campaign(campaign, tmp_path / "campaign.h5")
    return tmp_path / "campaign.h5"


def test_nothing_is_lost(campaign, path):
    again = read_campaign(path)
    for field in fields(Campaign):
        if field.name not in ("sets", "source"):
            assert getattr(again, field.name) == getattr(campaign, field.name), field.name
    assert again.machine.text == MACHINE
    assert again.source == str(path)
    assert again.sets[0].where(3) == campaign.sets[0].where(3)
    for a, b in zip(again.sets, campaign.sets, strict=True):
        assert_same_set(a, b)


def test_plain_h5py_reads_it(campaign, path):
    with h5py.File(path) as file:
        assert file.attrs["format"] == "volid-campaign/1"
        assert file["machine"].asstr()[()] == MACHINE
        assert list(file.attrs["axes"]) == ["X", "Y", "Z"]
        assert file["stations/name"].asstr()[1] == "S2"
        np.testing.assert_array_equal(file["stations/position"][1], [1200.0, 650.0, -650.0])
        volume = file["sets/1"]
        assert (volume.attrs["name"], volume.attrs["kind"]) == ("volume", "distance")
        assert volume["labels/segment"].asstr()[0] == "Strahl ä"
        assert (list(volume["readings"].attrs["columns"]), volume["readings"].attrs["unit"]) == (["distance"], "mm")
        np.testing.assert_array_equal(volume["positions"], campaign.sets[0].positions)
        np.testing.assert_array_equal(volume["readings"], campaign.sets[0].readings)


def test_a_campaign_without_stations_and_a_plan(tmp_path, campaign):
    readings = replace(campaign.sets[1], readings=np.full((10, 1), np.nan), rows=None)
    write_campaign(replace(campaign, stations=(), sets=(readings,)), tmp_path / "plan.h5")
    again = read_campaign(tmp_path / "plan.h5")
    assert again.stations == ()
    assert_same_set(again.sets[0], readings)


def test_truncated_file(path, tmp_path):
    whole = path.read_bytes()
    for length in (len(whole) // 2, 20):
        (tmp_path / "cut.h5").write_bytes(whole[:length])
        with pytest.raises(
            InputError, match=r"cut\.h5: the HDF5 file is truncated or damaged .*copy or write it again"
        ):
            load_campaign(tmp_path / "cut.h5")


def test_not_hdf5_missing_or_empty(tmp_path):
    (tmp_path / "text.h5").write_text("X,Y,Z")
    (tmp_path / "empty.h5").write_bytes(b"")
    for name in ("text.h5", "empty.h5"):
        with pytest.raises(InputError, match=rf"{name}: not an HDF5 file"):
            load_campaign(tmp_path / name)
        with pytest.raises(InputError, match=rf"{name}: not an HDF5 file; expected a campaign written by volid"):
            read_campaign(tmp_path / name)
    with pytest.raises(InputError, match=r"none\.h5: there is no such file"):
        load_campaign(tmp_path / "none.h5")
    with pytest.raises(InputError, match=r"is a folder; name the manifest in it, such as .*campaign\.toml"):
        load_campaign(tmp_path)
    with pytest.raises(InputError, match="no campaign was given"):
        load_campaign()


@pytest.mark.parametrize(
    ("tag", "message"),
    [
        ("volid-campaign/2", "format is 'volid-campaign/2'; this volid reads 'volid-campaign/1'"),
        ("volid-solution/1", r"this is a solution \('volid-solution/1'\); expected a campaign"),
    ],
)
def test_another_version_or_type(path, tag, message):
    with changed(path) as file:
        file.attrs["format"] = tag
    with pytest.raises(InputError, match=rf"campaign\.h5: {message}"):
        load_campaign(path)


def test_hdf5_of_another_program(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(InputError, match=r"other\.h5: HDF5, but no volid file: attribute 'format' is missing"):
        load_campaign(tmp_path / "other.h5")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: f.__delitem__("sets/1/readings"), r"incomplete campaign: .*readings"),
        (lambda f: f.__delitem__("sets/1/labels/station"), r"incomplete campaign: .*station"),
        (lambda f: f.attrs.__delitem__("title"), r"incomplete campaign: .*title"),
        (
            lambda f: f["sets/1"].attrs.__setitem__("kind", "distanz"),
            r"sets/1: unknown kind 'distanz'; did you mean 'dis",
        ),
        (lambda f: f["sets/2"].attrs.__setitem__("name", "volume"), r"two sets are called 'volume'"),
        (lambda f: f["stations/name"].__setitem__(0, b"T9"), r"volume\.csv, row 2: station 'S1' is unknown"),
    ],
)
def test_inconsistent_file(path, spoil, message):
    with changed(path) as file:
        spoil(file)
    with pytest.raises(InputError, match=message):
        read_campaign(path)


def test_wrong_shape(path):
    with changed(path) as file:
        del file["sets/1/tool"]
        file["sets/1/tool"] = np.zeros((54, 2))
    with pytest.raises(InputError, match=r"sets/1/tool: shape is \(54, 2\); expected \(54, 3\)"):
        read_campaign(path)


def test_existing_output_and_places_that_cannot_be_written(campaign, path, tmp_path):
    before = path.read_bytes()
    with pytest.raises(OutputError, match=r"campaign\.h5 exists; choose another name or pass `overwrite=True`"):
        write_campaign(campaign, path)
    assert path.read_bytes() == before
    write_campaign(replace(campaign, title="New"), path, overwrite=True)
    assert read_campaign(path).title == "New"
    with pytest.raises(OutputError, match=r"cannot be written: .*campaign\.h5 is not a folder"):
        write_campaign(campaign, path / "below.h5")
    with pytest.raises(OutputError, match=r"cannot be written: the folder .*nowhere does not exist"):
        write_campaign(campaign, tmp_path / "nowhere" / "c.h5")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["campaign.h5", "text"]


def test_a_machine_that_was_changed_in_python_is_stored_as_it_is(campaign, tmp_path):
    machine = campaign.machine
    changed = type(machine)("Renamed", machine.structure, machine.axes, machine.datum, machine.model, machine.text)
    write_campaign(replace(campaign, machine=changed), tmp_path / "c.h5")
    assert read_campaign(tmp_path / "c.h5").machine.name == "Renamed"


# ---------------------------------------------------------------------------------------------- several files

SECOND = (
    MANIFEST.replace('"volume"', '"validation"').replace('"levels"', '"other levels"').replace("Acceptance", "Second")
)


def test_text_and_hdf5_are_merged(path, campaign, tmp_path):
    second = write_files(tmp_path / "second", manifest=SECOND, machine=MACHINE + "\n\n")
    merged = load_campaign(path, second)
    assert [s.name for s in merged.sets] == ["volume", "levels", "validation", "other levels"]
    assert merged.stations == campaign.stations
    assert merged.title == "Acceptance; Second"
    assert merged.conditions[str(path)] == campaign.conditions
    assert merged.conditions[str(second)]["warm_up"] == "30 min axis cycle"
    assert merged.warnings == campaign.warnings
    assert merged.n_readings == 2 * campaign.n_readings


def test_one_text_campaign(tmp_path):
    path = write_files(tmp_path)
    assert load_campaign(path).n_readings == 54 + len(level_rows()["value"])
    assert np.isnan(
        load_campaign(write_files(tmp_path / "p", volume="X,Y,Z,station\n0,0,0,S1\n"), plan=True).sets[0].readings
    ).all()


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (
            {"machine": MACHINE.replace("600.0", "601.0")},
            r"machine 'Test machine' is not the machine .* of .*campaign\.h5",
        ),
        (
            {"manifest": SECOND.replace("-150.0, 80.0", "-150.0, 81.0")},
            r"station 'S1' is defined otherwise in .*campaign\.h5",
        ),
        ({"manifest": MANIFEST}, r"two sets are called 'volume'"),
    ],
)
def test_files_that_do_not_go_together(path, tmp_path, texts, message):
    second = write_files(tmp_path / "second", **({"manifest": SECOND} | texts))
    with pytest.raises(InputError, match=message):
        load_campaign(path, second)
