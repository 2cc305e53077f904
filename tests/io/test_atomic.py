"""Outputs appear whole or not at all, and say where they come from."""

import hashlib
import os
import shlex
import stat
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from volid.exceptions import InputError, OutputError
from volid.io.basics import parts
from volid.io.basics.atomic import atomic_folder, atomic_output, atomic_with_companions, write_bytes
from volid.io.basics.provenance import provenance


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_output_appears_at_success(tmp_path):
    with atomic_output(tmp_path / "out.csv") as temporary:
        temporary.write_text("whole")
        assert temporary.parent.parent == tmp_path, "on the same disk"
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


def test_folders_within_a_folder_are_filled_again(tmp_path):
    for text in ("old", "new"):
        with atomic_folder(tmp_path / "out", overwrite=True) as temporary:
            (temporary / "inner").mkdir()
            (temporary / "inner" / "a.csv").write_text(text)
            (temporary / "inner" / f"{text}.csv").write_text(text)
    inner = tmp_path / "out" / "inner"
    assert (inner / "a.csv").read_text() == "new" and names(inner) == ["a.csv", "new.csv", "old.csv"]


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
    with pytest.raises(OutputError, match="is no folder; name a folder"), atomic_folder(tmp_path / "a.csv", True):
        pytest.fail("the block must not run")
    with (
        pytest.raises(OutputError, match=r"cannot be written: .*a\.csv is not a folder"),
        atomic_folder(tmp_path / "a.csv" / "out"),
    ):
        pytest.fail("the block must not run")


# ------------------------------------------------------------------------------- what is no regular file, and links


@pytest.fixture
def pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


def test_a_pipe_is_written_through_and_stays(pipe, tmp_path):
    reader = subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE)
    write_bytes(pipe, b"whole")
    assert reader.communicate(timeout=60)[0] == b"whole"
    assert stat.S_ISFIFO(os.stat(pipe).st_mode)
    assert names(tmp_path) == ["pipe"]


def test_the_null_device_is_never_replaced(tmp_path):
    """A node of its own where this process may make one, so that a failure costs nothing."""
    device = tmp_path / "null"
    try:
        os.mknod(device, stat.S_IFCHR | 0o666, os.makedev(1, 3))
    except OSError:
        device = Path("/dev/null")
    for overwrite in (False, True):
        with suppress(OutputError):  # a folder on a disk without devices
            write_bytes(device, b"nothing", overwrite)
        assert stat.S_ISCHR(os.stat(device).st_mode)
    (tmp_path / "link").symlink_to("/dev/null")
    write_bytes(tmp_path / "link", b"nothing")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    assert (tmp_path / "link").is_symlink()


def test_a_full_device_is_an_output_error():
    with pytest.raises(OutputError, match="/dev/full cannot be written: No space left on device"):
        write_bytes("/dev/full", b"x")


def test_a_link_stays_and_its_file_is_replaced_in_its_own_folder(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "file.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to("there/file.csv")
    with pytest.raises(OutputError, match=r"link\.csv exists"):
        write_bytes(tmp_path / "link.csv", b"new")
    with atomic_output(tmp_path / "link.csv", overwrite=True) as temporary:
        assert temporary.parent.parent == tmp_path / "there"
        temporary.write_text("new")
    assert (tmp_path / "there" / "file.csv").read_text() == "new"
    assert os.readlink(tmp_path / "link.csv") == "there/file.csv"
    assert names(tmp_path / "there") == ["file.csv"]


def test_links_that_lead_nowhere_or_in_a_circle(tmp_path):
    (tmp_path / "nowhere").symlink_to("missing")
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(OutputError, match="nowhere exists"):
        write_bytes(tmp_path / "nowhere", b"x")
    write_bytes(tmp_path / "nowhere", b"x", overwrite=True)
    assert (tmp_path / "missing").read_bytes() == b"x"
    with pytest.raises(OutputError, match="leads back to itself"):
        write_bytes(tmp_path / "circle", b"x", overwrite=True)
    assert (tmp_path / "circle").is_symlink()


def test_within_folders_too(tmp_path):
    """A folder that is a link, files in it that are links, and companions."""
    (tmp_path / "real").mkdir()
    (tmp_path / "elsewhere.csv").write_text("old")
    (tmp_path / "real" / "a.csv").symlink_to("../elsewhere.csv")
    (tmp_path / "folder").symlink_to("real")
    with atomic_folder(tmp_path / "folder", overwrite=True) as temporary:
        (temporary / "a.csv").write_text("new")
    assert (tmp_path / "elsewhere.csv").read_text() == "new"
    assert (tmp_path / "real" / "a.csv").is_symlink()
    assert (tmp_path / "folder").is_symlink()
    with (
        pytest.raises(OutputError, match="/dev/null is no file, and 2 files are written"),
        atomic_with_companions("/dev/null", ["null.csv"]),
    ):
        pytest.fail("the block must not run")


def test_who_may_read_a_file_stays_so(tmp_path):
    (tmp_path / "a").write_text("old")
    (tmp_path / "a").chmod(0o640)
    write_bytes(tmp_path / "a", b"new", overwrite=True)
    assert stat.S_IMODE(os.stat(tmp_path / "a").st_mode) == 0o640


def test_a_writer_in_another_container_of_the_same_name_is_left_alone(tmp_path, monkeypatch):
    """Its process number means nothing here: another process here, or none. The lock is what both see."""
    script = (
        "import sys; from volid.io.basics.atomic import atomic_output\n"
        "with atomic_output(sys.argv[1]) as temporary:\n"
        "    temporary.write_text('theirs'); print('ready', flush=True); sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script, tmp_path / "out"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "ready\n"
        monkeypatch.setattr(parts, "_runs", lambda process: False)
        with pytest.raises(ZeroDivisionError), atomic_output(tmp_path / "out"):
            raise ZeroDivisionError
        assert len(names(tmp_path)) == 1
        other.communicate(timeout=60)
    assert (tmp_path / "out").read_text() == "theirs"


def test_provenance(tmp_path):
    path = tmp_path / "campaign.h5"
    path.write_bytes(b"readings")
    record = provenance([path], ["volid", "fit"], {"robust": True})
    assert record[f"sha256 {path}"] == hashlib.sha256(b"readings").hexdigest()
    assert (record["command"], record["options"]) == ("volid fit", '{"robust": true}')
    words = ["volid", "report", "my solution.h5", "-o", "it's.html"]
    assert shlex.split(provenance([], words)["command"]) == words  # it can be run again as it stands
    assert record["date"].endswith("+00:00")
    assert all(isinstance(value, str) for value in record.values())
    assert record["numpy"] == __import__("numpy").__version__
    with pytest.raises(InputError, match=r"none\.h5: cannot be read: No such file"):
        provenance([tmp_path / "none.h5"])
