"""Where things are in the repository, and measurements by others that are not part of it."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "src"
MODELS = ROOT / "models"
DATASETS = ROOT / "datasets"
TESTS = ROOT / "tests"
LITERATURE = TESTS / "literature"
BUNDLED = DATASETS / "vertical_multilateration" / "campaign.toml"


def reference_file(name: str) -> Path:
    """Path of a file in the folder of reference data that VOLID_REFERENCE names; skips without one."""
    given = os.environ.get("VOLID_REFERENCE")
    if given and (Path(given) / name).exists():
        return Path(given) / name
    pytest.skip(f"reference data {name} are not at hand (VOLID_REFERENCE names their folder)")
