"""Where a result comes from: versions, input files, options and date, as text that goes into every result."""

from __future__ import annotations

import hashlib
import json
import platform
import shlex
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from volid.exceptions import InputError, shown

PACKAGES = ("volid", "numpy", "scipy", "jax", "jaxlib", "equinox", "lineax", "optimistix", "h5py")


def provenance(
    inputs: Iterable[str | Path] = (), command: Sequence[str] = (), options: Mapping[str, Any] | None = None
) -> dict[str, str]:
    """Record of a run, all text: "date" (UTC), "python", one entry per package, "command" as a shell takes it,
    "options" (JSON), and "sha256 <path>" for each input file. A path that is no text appears as in messages.

    Raises `InputError` when an input file cannot be read.
    """
    record = {"date": datetime.now(UTC).isoformat(timespec="seconds"), "python": platform.python_version()}
    record |= {package: _version(package) for package in PACKAGES}
    if command:
        record["command"] = shlex.join(command)
    if options:
        record["options"] = json.dumps(dict(options), ensure_ascii=False, default=str)
    record |= {f"sha256 {path}": sha256(path) for path in inputs}
    return {shown(key): shown(text) for key, text in record.items()}


def sha256(path: str | Path) -> str:
    """SHA-256 of a file in hexadecimal digits. Raises `InputError` when it cannot be read."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}; expected a readable file") from None


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
