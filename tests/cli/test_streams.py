"""Standard output as a file, streams that are closed or full, names that are no text, and faults of volid itself."""

import os
import re
import stat
import subprocess
import sys

import h5py
import pytest
from support.places import DATASETS, SOURCE

from volid.cli import main, summary
from volid.cli.faults import FAULT

CAMPAIGN = DATASETS / "published_positioning" / "campaign.toml"


@pytest.fixture(scope="module")
def solution(tmp_path_factory):
    path = tmp_path_factory.mktemp("solution") / "s.h5"
    assert main(["fit", str(CAMPAIGN), "-o", str(path)]) == 0
    return path


def shell(command, folder, **options):
    """Runs a line of the shell, in which `volid` is the command."""
    environment = os.environ | {"PYTHONPATH": str(SOURCE)}
    text = f'volid() {{ "{sys.executable}" -m volid "$@"; }}\n{command}'
    return subprocess.run(
        ["bash", "-c", text], cwd=folder, env=environment, capture_output=True, timeout=300, check=False, **options
    )


# ---------------------------------------------------------------------------------------- standard output by name


@pytest.mark.parametrize("name", ["-", "/dev/stdout", "/dev/fd/1"])
def test_standard_output_can_be_named(name, solution, tmp_path):
    """The file alone goes there, the words to standard error; it is what a file would hold but for the line of the command."""
    done = shell(f"volid functions {solution} -o {name} > out.csv; volid functions {solution} -o file.csv", tmp_path)
    lines, expected = ((tmp_path / n).read_text().splitlines() for n in ("out.csv", "file.csv"))
    assert [line for line in lines if "date:" not in line] == [line for line in expected if "date:" not in line]
    assert b"written: standard output\n" in done.stderr and b"/dev/stdout" not in done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file.csv", "out.csv"]


def test_what_stands_in_a_file_before_stays(solution, tmp_path):
    """The shell's file is written on, as by every other program."""
    shell(f"(echo first; volid functions {solution} -o -; echo last) > out.csv", tmp_path)
    lines = (tmp_path / "out.csv").read_text().splitlines()
    assert (lines[0], lines[-1]) == ("first", "last")
    assert len(lines) > 50


def test_process_substitution(solution, tmp_path):
    done = shell(f"volid functions {solution} -o >(head -1 > first.txt); sleep 1; cat first.txt", tmp_path)
    assert b"# values: error functions" in done.stdout, done.stderr


def test_hdf5_to_standard_output(tmp_path):
    done = shell(f"volid import {CAMPAIGN} -o - > c.h5", tmp_path)
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "c.h5") as file:
        assert file.attrs["format"] == "volid-campaign/1"


def test_both_cannot_go_to_standard_output(solution, run):
    status, out, err = run("functions", solution, "-o", "-", "--json")
    assert (status, out) == (2, "")
    assert "-o - and --json both write to standard output" in err


def test_standard_output_is_no_folder(solution, run):
    status, out, err = run("figures", solution, "-o", "-")
    assert (status, out) == (2, "")
    assert err == "volid figures: standard output is no folder; name a folder\n"


@pytest.mark.parametrize("verb", ["uncertainty", "plan"])
def test_several_files_need_a_name(verb, solution, run):
    arguments = [solution] if verb == "uncertainty" else [CAMPAIGN.with_name("machine.toml")]
    status, _, err = run(verb, *arguments, "-o", "/dev/stdout", "--force")
    assert status == 2
    assert "name a file" in err or "ends in .toml" in err


# ----------------------------------------------------------------------------------------- streams that take nothing


def test_a_reader_that_has_seen_enough(solution, tmp_path):
    for output in ("", "-o -"):
        done = shell(f"volid functions {solution} {output} | true; echo ${{PIPESTATUS[0]}}", tmp_path)
        assert done.stdout in (b"141\n", b"0\n")  # 0 where all was written before the reader went
        assert b"Error" not in done.stderr
        assert b"Exception" not in done.stderr


@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-", "<&- >&-"])
def test_a_closed_standard_output_ends_quietly(closed, solution, tmp_path):
    done = shell(f"volid functions {solution} {closed}; echo $?", tmp_path)
    assert done.stdout == b"141\n"
    assert b"Error" not in done.stderr  # but for words on what is being done, where that takes a while
    assert b"Exception" not in done.stderr


def test_a_file_is_written_though_standard_output_is_closed(solution, tmp_path):
    """No file takes the place of the closed descriptor, where words would be written into it."""
    shell(f"volid functions {solution} -o out.csv >&-", tmp_path)
    assert (tmp_path / "out.csv").read_text().startswith("# values")
    assert "written:" not in (tmp_path / "out.csv").read_text()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_behind_standard_output(solution, tmp_path):
    done = shell(f"volid functions {solution} > /dev/full", tmp_path)
    assert done.returncode == 2
    assert (
        done.stderr.decode().splitlines(True)[-1]
        == "volid: standard output or a file cannot be written: No space left on device\n"
    )


def test_force_leaves_a_device_and_a_link_what_they_are(solution, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "old.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to("old.csv")
    done = shell(
        f"cat pipe > read.csv & volid functions {solution} -o pipe --force; wait; "
        f"volid functions {solution} -o link.csv --force; volid functions {solution} -o /dev/null --force",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert stat.S_ISFIFO(os.stat(tmp_path / "pipe").st_mode)
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    assert (tmp_path / "link.csv").is_symlink()
    for name in ("old.csv", "read.csv"):
        assert (tmp_path / name).read_text().startswith("# values"), name


# ------------------------------------------------------------------------------------------------ names, and faults


def test_a_name_that_is_no_text(tmp_path):
    done = shell(r"volid fit $'\xff\x1b[2J.toml' -o o.h5", tmp_path)
    assert done.returncode == 2
    assert (
        done.stderr.decode().splitlines(True)[-1]
        == "volid fit: \\xff\\x1b[2J.toml: there is no such file; check the name and the folder\n"
    )


def test_files_whose_names_are_no_text(tmp_path):
    done = shell(
        rf"cp -r {CAMPAIGN.parent} $'\xff'; cd $'\xff'; volid import campaign.toml -o $'\xfe.h5' && "
        r"volid fit ../$'\xff'/$'\xfe.h5' -o $'\xfd.h5' --json && volid functions $'\xfd.h5' -o $'\xfc.csv'",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert rb"\udcfd.h5" in done.stdout
    assert rb"written: \xfc.csv" in done.stdout


FAULTS = [
    ZeroDivisionError("division by zero"),
    RecursionError("too deep"),
    MemoryError(),
    KeyError("x"),
    OSError(13, "no", "f"),
]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: type(fault).__name__)
def test_whatever_is_unforeseen_is_one_line_and_a_file(fault, run, tmp_path, monkeypatch):
    """There is no known fault to show it with, so a command raises one."""

    def fails(args):
        raise fault

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(summary, "run", fails)
    status, out, err = run("summary", "s\x1b.h5")
    assert (status, out) == (FAULT, "")
    assert len(err.splitlines()) == 1
    assert type(fault).__name__ in err
    (file,) = tmp_path.iterdir()
    assert file.name in err
    text = file.read_text()
    assert "command: volid summary 's\\x1b.h5'" in text
    assert re.search(r"^numpy: \d", text, re.MULTILINE)
    assert "Traceback" in text
    assert "in fails" in text


def test_a_fault_is_reported_where_the_working_folder_is_closed(run, tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "gone").rmdir()
    monkeypatch.setattr(summary, "run", lambda args: 1 // 0)
    status, _, err = run("summary", "s.h5")
    assert status == FAULT
    assert str(next(tmp_path.glob("volid-fault-*.txt"))) in err
    monkeypatch.chdir(tmp_path)


def test_the_exit_statuses_are_told(run):
    _, out, _ = run("--help")
    assert f"{FAULT} a fault of volid itself" in out
