"""What every format of another program owes: recognised by content, refused where it is another one, never a traceback."""

import itertools
import time

import numpy as np
import pytest
from support.campaign_files import MANIFEST, csv_text, volume_rows, write_files
from support.instrument_files import SAMPLES
from support.places import MODELS, ROOT

import volid
from volid.exceptions import InputError
from volid.io.basics.toml_table import format_lines
from volid.io.campaign.imported import evaluation_of, import_files
from volid.io.instruments import FORMATS
from volid.io.instruments.base import ReadingsFormat
from volid.io.instruments.recognition import format_called, open_foreign, recognised, what_it_seems

MACHINE = MODELS / "wYXbZt_vertical.toml"
READINGS = [name for name, known in FORMATS.items() if isinstance(known, ReadingsFormat)]


def write(folder, name, ending="dat"):
    path = folder / f"sample.{ending}"
    path.write_bytes(SAMPLES[name].text.encode())
    SAMPLES[name].write_beside(folder)
    return path


@pytest.fixture(autouse=True)
def _in_its_folder(tmp_path, monkeypatch):
    """Keys name files as seen from where the command runs."""
    monkeypatch.chdir(tmp_path)


def test_every_format_has_a_sample():
    assert set(SAMPLES) == set(FORMATS)
    assert [name for name in FORMATS if SAMPLES[name].kind] == READINGS


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_is_recognised_by_its_content(name, tmp_path):
    assert recognised(open_foreign(write(tmp_path, name))).name == name


@pytest.mark.parametrize(("stated", "name"), list(itertools.permutations(FORMATS, 2)))
def test_a_file_of_another_format_is_refused_and_named(stated, name, tmp_path):
    path = write(tmp_path, name, stated)
    with pytest.raises(InputError, match=rf'sample.{stated}: this seems to be .*\(as = "{name}"\); expected') as caught:
        evaluation_of(path, stated)
    assert FORMATS[name].words in str(caught.value) and FORMATS[stated].words in str(caught.value)
    if stated in READINGS:
        with pytest.raises(InputError, match="this seems to be"):
            import_files([path], MACHINE, {**SAMPLES[stated].keys, "as": stated})


OTHERS = {
    "an HDF5 file": b"\x89HDF\r\n\x1a\n" + bytes(100),
    "an image (PNG)": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "an image (JPEG)": b"\xff\xd8\xff\xe0" + bytes(100),
    "an image (BMP)": b"BM6\x00\x00\x00\x00\x00" + bytes(100),
    "a workbook or archive": b"PK\x03\x04" + bytes(100),
    "a PDF document": b"%PDF-1.7\n",
    "the file is empty": b"  \r\n ",
    "stands in no text": b"abc\x00\x01\x02",
    "a machine file of volid": MACHINE.read_bytes(),
    "a campaign of volid": MANIFEST.encode(),
    "a table of delimited columns": csv_text(volume_rows()).encode(),
    "a web page": b"<!DOCTYPE html><html><body>HEADER::</body></html>",
    "an XML document of another type": b'<?xml version="1.0"?><a><FEATURE NAME="X"/></a>',
    "a JSON document": b'{"a": 1}',
    "a text of no known type": (ROOT / "LICENSE").read_bytes(),
}


@pytest.mark.parametrize("what", OTHERS)
@pytest.mark.parametrize("name", [*FORMATS, "auto"])
def test_what_is_no_such_file_is_named(what, name, tmp_path):
    path = tmp_path / f"file.{name}"
    path.write_bytes(OTHERS[what])
    with pytest.raises(InputError, match=r"file\.\w+(, line \d+)?: ") as caught:
        evaluation_of(path, name)
    assert what in str(caught.value)


def test_files_of_volid_are_named(tmp_path):
    """A real campaign in HDF5 has a checksum before the signature of HDF5."""
    path = tmp_path / "campaign.rtl"
    volid.save_campaign(volid.load_campaign(write_files(tmp_path / "text")), tmp_path / "c.h5")
    path.write_bytes((tmp_path / "c.h5").read_bytes())
    with pytest.raises(InputError, match=r"campaign.rtl: this is an HDF5 file"):
        evaluation_of(path, "rtl")


@pytest.mark.parametrize("name", READINGS)
def test_readings_are_the_same_through_manifest_options_text_and_hdf5(name, tmp_path):
    path = write(tmp_path, name, name)
    (tmp_path / "machine.toml").write_bytes(MACHINE.read_bytes())
    keys = {"name": "sample", "file": path.name, "as": name, **SAMPLES[name].keys}
    head = ['format = "volid-campaign/1"', 'machine = "machine.toml"', "[[set]]", *format_lines(keys)]
    (tmp_path / "c.toml").write_text("\n".join(head), encoding="utf-8")
    stated = volid.load_campaign(tmp_path / "c.toml")
    optional = import_files([path], MACHINE, SAMPLES[name].keys)
    volid.save_campaign(stated, tmp_path / "c.h5")
    volid.io.write_manifest(stated, tmp_path / "again")
    campaigns = [
        stated,
        optional,
        volid.load_campaign(tmp_path / "c.h5"),
        volid.load_campaign(tmp_path / "again/campaign.toml"),
    ]
    for campaign in campaigns:
        (found,), (first,) = campaign.sets, stated.sets
        assert found.kind == SAMPLES[name].kind
        for what in ("positions", "directions", "tool", "readings", "u"):
            np.testing.assert_array_equal(getattr(found, what), getattr(first, what))
        assert {k: v.tolist() for k, v in found.labels.items()} == {k: v.tolist() for k, v in first.labels.items()}
        record = campaign.conditions["imported"]["sample"]
        assert (record["file"], record["as"]) == (path.name, name)


def test_a_file_is_not_taken_for_a_campaign(tmp_path):
    with pytest.raises(
        InputError, match=r'this is .* and no campaign; name it in a \[\[set\]\] of a manifest, with as = "rtl"'
    ):
        volid.load_campaign(write(tmp_path, "rtl", "rtl"))


def test_an_unknown_format_is_named():
    with pytest.raises(InputError, match=r"here: as is 'rtk'; did you mean 'rtl'\? this version reads rtl, "):
        format_called("rtk", "here")


N = 100_000
LONG = {
    "empty lines": "\n" * 3 * N,
    "blanks": " " * 3 * N,
    "tabs": "\t" * 3 * N,
    "pairs": "a: b\n" * N,
    "headings": "A::\n" * N,
    "one word": "x" * 3 * N,
    "a heading and blanks": "Position" + " " * 3 * N,
    "headings of tables": "Position " * N,
    "elements": "<FEATURE " * N,
    "an element and blanks": "<FEATURE NAME" + " " * 3 * N,
    "sections with blanks": "HEADER::\nTARGET DATA::\na:" + " " * 3 * N + "b\nDEVIATIONS::\nRun Target Data:\n",
}


@pytest.mark.parametrize("what", LONG)
@pytest.mark.timeout(60)
def test_no_text_takes_a_time_that_grows_with_the_square(what):
    """Squares of these lengths would take minutes; what is linear takes milliseconds."""
    began = time.process_time()
    what_it_seems(LONG[what])
    for known in FORMATS.values():
        known.recognises(LONG[what])
    assert time.process_time() - began < 10.0


# -------------------------------------------------------------------------------------------------- command line


def options(name):
    """The keys of a sample as options."""
    keys = SAMPLES[name].keys
    known = {"axis": "--axis", "component": "--component", "u": "--u", "unit": "--unit"}
    found = ["--machine", MACHINE]
    for key, value in keys.items():
        if key == "at":
            found += ["--at", ",".join(f"{a}={q}" for a, q in value.items())]
        elif key == "tool":
            found += ["--tool", ",".join(map(str, value))]
        elif key in known:
            found += [known[key], value]
        else:
            found += ["--key", format_lines({key: value})[0]]
    return found


@pytest.mark.parametrize("name", READINGS)
def test_the_command_makes_a_campaign(name, run, tmp_path):
    status, text, err = run("import", write(tmp_path, name, name), *options(name), "-o", tmp_path / "c.h5")
    assert status == 0, err
    assert f"set sample: {volid.load_campaign(tmp_path / 'c.h5').n_readings} readings" in text


def test_the_command_lists_formats_and_help_leads_there(run, tmp_path):
    status, text, _ = run("import", "--formats")
    assert status == 0
    for name, known in FORMATS.items():
        assert f"{name}: {known.words}" in text
    assert text.count("no vendor file was at hand") >= 4
    assert "--formats lists the types" in run("import", "--help")[1].replace("\n", " ")


def test_the_command_names_what_is_missing(run, tmp_path):
    path = write(tmp_path, "rtl", "rtl")
    assert "name the machine that was measured with --machine" in run("import", path)[2]
    err = run("import", path, "--machine", MACHINE)[2]
    assert "this makes a campaign; name its file with -o" in err
    assert (
        "no position of Y, Z; expected where every axis stood while X moved"
        in run("import", path, "--machine", MACHINE, "-o", tmp_path / "c.h5")[2]
    )
    err = run("import", path, *options("rtl")[:-2], "-o", tmp_path / "c.h5")[2]
    assert "there is no standard uncertainty; add u = …" in err
    assert "this is readings" not in err
    assert run("import", path, *options("rtl"), "--key", "axis", "-o", tmp_path / "c.h5")[0] == 2
    assert not (tmp_path / "c.h5").exists()
