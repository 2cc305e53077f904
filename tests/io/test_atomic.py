"""Outputs appear whole or not at all, and say where they come from."""

import hashlib
import subprocess
import sys

import pytest

from volid.exceptions import InputError, OutputError
from volid.io.basics.atomic import atomic_folder, atomic_output
from volid.io.basics.provenance import provenance


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_output_appears_at_success(tmp_path):
    with atomic_output(tmp_path / "out.csv") as temporary:
        temporary.write_text("whole")
        assert temporary.parent == tmp_path
        assert not (tmp_path / "out.csv").exists()
    assert (tmp_path / "out.csv").read_text() == "whole"
    assert names(tmp_path) == ["out.csv"]


def test_nothing_is_left_after_a_failure(tmp_path):
    with pytest.raises(ZeroDivisionError), atomic_output(tmp_path / "out.csv") as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert names(tmp_path) == []


def test_what_a_killed_process_left_is_removed_at_the_next_writing(tmp_path):
    script = (
        "import os, sys; from volid.io.basics.atomic import atomic_output, atomic_folder\n"
        "with atomic_output(sys.argv[1]) as one, atomic_folder(sys.argv[2]) as two:\n"
        "    one.write_text('half'); (two / 'x').write_text('half'); os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", script, tmp_path / "out.csv", tmp_path / "folder"], check=False)
    assert len(names(tmp_path)) == 2, "the killed process left nothing to be removed"
    with atomic_output(tmp_path / "out.csv") as first, atomic_folder(tmp_path / "folder") as second:
        first.write_text("whole")
        with pytest.raises(ZeroDivisionError), atomic_output(tmp_path / "out.csv"):
            assert first.exists(), "the file of a living writer is left alone"
            raise ZeroDivisionError
        (second / "x").write_text("whole")
    assert names(tmp_path) == ["folder", "out.csv"]


def test_existing_output_is_refused_and_left_alone(tmp_path):
    (tmp_path / "out.csv").write_text("old")
    with (
        pytest.raises(OutputError, match=r"out\.csv exists; choose another name or pass `overwrite=True`"),
        atomic_output(tmp_path / "out.csv"),
    ):
        pytest.fail("the block must not run")
    assert (tmp_path / "out.csv").read_text() == "old"


def test_overwriting_replaces_at_success_only(tmp_path):
    path = tmp_path / "out.csv"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_output(path, overwrite=True) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    with atomic_output(path, overwrite=True) as temporary:
        temporary.write_text("new")
    assert path.read_text() == "new"
    assert names(tmp_path) == ["out.csv"]


def test_output_that_appears_meanwhile_is_not_overwritten(tmp_path):
    path = tmp_path / "out.csv"
    with pytest.raises(OutputError, match="exists"), atomic_output(path) as temporary:
        temporary.write_text("mine")
        path.write_text("somebody else's")
    assert path.read_text() == "somebody else's"


def test_places_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(OutputError, match=r"cannot be written: .*file is not a folder"),
        atomic_output(tmp_path / "file" / "out.csv") as temporary,
    ):
        temporary.write_text("")
    with (
        pytest.raises(OutputError, match=r"the folder .*nowhere does not exist; create it"),
        atomic_output(tmp_path / "nowhere" / "out.csv") as temporary,
    ):
        temporary.write_text("")
    with pytest.raises(OutputError, match="is a folder; name a file"), atomic_output(tmp_path, overwrite=True):
        pytest.fail("the block must not run")


def test_folder_appears_at_success_only(tmp_path):
    with pytest.raises(ZeroDivisionError), atomic_folder(tmp_path / "out") as temporary:
        (temporary / "a.csv").write_text("half")
        raise ZeroDivisionError
    assert names(tmp_path) == []
    with atomic_folder(tmp_path / "out") as temporary:
        (temporary / "a.csv").write_text("whole")
    assert (tmp_path / "out" / "a.csv").read_text() == "whole"
    assert names(tmp_path) == ["out"]


def test_the_working_folder_can_be_named_by_a_dot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with atomic_folder(".") as temporary:
        (temporary / "a.csv").write_text("whole")
    with atomic_output("b.csv") as temporary:
        temporary.write_text("whole")
    assert names(tmp_path) == ["a.csv", "b.csv"]


def test_folder_that_holds_something(tmp_path):
    (tmp_path / "a.csv").write_text("old")
    (tmp_path / "other.txt").write_text("other")
    with (
        pytest.raises(OutputError, match="exists; choose another name or pass `overwrite=True`"),
        atomic_folder(tmp_path),
    ):
        pytest.fail("the block must not run")
    with atomic_folder(tmp_path, overwrite=True) as temporary:
        (temporary / "a.csv").write_text("new")
    assert (tmp_path / "a.csv").read_text() == "new"
    assert (tmp_path / "other.txt").read_text() == "other"
    with pytest.raises(OutputError, match="is a file; name a folder"), atomic_folder(tmp_path / "a.csv", True):
        pytest.fail("the block must not run")
    with (
        pytest.raises(OutputError, match=r"cannot be written: .*a\.csv is not a folder"),
        atomic_folder(tmp_path / "a.csv" / "out"),
    ):
        pytest.fail("the block must not run")


def test_provenance(tmp_path):
    path = tmp_path / "campaign.h5"
    path.write_bytes(b"readings")
    record = provenance([path], ["volid", "fit"], {"robust": True})
    assert record[f"sha256 {path}"] == hashlib.sha256(b"readings").hexdigest()
    assert (record["command"], record["options"]) == ("volid fit", '{"robust": true}')
    assert record["date"].endswith("+00:00")
    assert all(isinstance(value, str) for value in record.values())
    assert record["numpy"] == __import__("numpy").__version__
    with pytest.raises(InputError, match=r"none\.h5: cannot be read: No such file"):
        provenance([tmp_path / "none.h5"])
