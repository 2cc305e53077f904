"""A source distribution holds all that its tests need: every file that the repository keeps."""

import os
import re
import subprocess
import sys

import pytest
from support.places import ROOT

KEPT = (".ci", "benchmarks", "datasets", "docs", "examples", "models", "notebooks", "tests")


def kept_files():
    """Files of the repository: those that git knows or would add; without git, what lies there."""
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode == 0 and listed.stdout:
        return {name for name in listed.stdout.splitlines() if (ROOT / name).is_file()}
    return {p.relative_to(ROOT).as_posix() for top in KEPT for p in (ROOT / top).rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def included():
    """Files that MANIFEST.in takes along, by setuptools' own reading of it."""
    path = sys.path.copy()
    filelist = pytest.importorskip("setuptools.command.egg_info").FileList(
        warn=lambda *_: None, debug_print=lambda *_: None
    )
    before = os.getcwd()
    os.chdir(ROOT)
    try:
        filelist.findall()
        for line in (ROOT / "MANIFEST.in").read_text(encoding="utf-8").splitlines():
            if line and not line.startswith("#"):
                filelist.process_template_line(line)
    finally:
        os.chdir(before)
        sys.path[:] = path  # setuptools puts its own copies of other packages there
    return {re.sub(r"^\./", "", name.replace(os.sep, "/")) for name in filelist.files}


def test_all_that_tests_read_is_included(included):
    needed = {name for name in kept_files() if not name.startswith("src/") and "__pycache__" not in name}
    assert len(needed) > 200 and needed - included <= {"MANIFEST.in"}
    assert {"tests/cases/README.md", "models/README.md", "CONVENTIONS.md"} <= included


def test_nothing_compiled_is_included(included):
    assert not [name for name in included if "__pycache__" in name or name.endswith(".pyc")]
