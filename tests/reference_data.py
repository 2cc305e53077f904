"""Measurements by others that are not part of the project: found beside the checkout or where VOLID_REFERENCE says."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def reference_file(name: str) -> Path:
    """Path of a file in the folder of reference data; skips the test where there is none."""
    given = os.environ.get("VOLID_REFERENCE")
    folders = [Path(given)] if given else [*ROOT.glob("reference/real"), *ROOT.parent.glob("*/reference/real")]
    for folder in folders:
        if (folder / name).exists():
            return folder / name
    pytest.skip(f"reference data {name} are not at hand (VOLID_REFERENCE names their folder)")
