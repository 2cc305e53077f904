"""A fault of volid itself: one line on standard error, a file to send, and an exit status of its own."""

from __future__ import annotations

import os
import platform
import shlex
import sys
import tempfile
import traceback
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from volid.exceptions import cut, shown

FAULT = 70  # EX_SOFTWARE of sysexits.h
_PACKAGES = ("volid", "numpy", "scipy", "jax", "jaxlib", "equinox", "lineax", "optimistix", "h5py", "matplotlib")


def report_fault(verb: str, error: BaseException, arguments: Sequence[str]) -> int:
    """Say it in one line, write the file, return the exit status."""
    name = f"volid {verb}".rstrip()
    what = cut(f"{type(error).__name__}: {' '.join(str(error).split())}".removesuffix(": "), 300)
    file = _write(_text(error, arguments))
    send = (
        f"please send the file {file} (command line, versions and place in the program; no readings)"
        if file
        else ("no report could be written; please send the command line")
    )
    print(f"{name}: a fault of volid itself, {what}; no file is half written; {send}", file=sys.stderr)
    return FAULT


def _text(error: BaseException, arguments: Sequence[str]) -> str:
    lines = [
        "A fault of volid itself. Look through this file before you send it: names of files and values stand in it.",
        f"command: {shlex.join(['volid', *arguments])}",
        f"date: {datetime.now(UTC).isoformat(timespec='seconds')}",
        f"system: {platform.platform()}, {os.cpu_count()} processors",
        f"python: {platform.python_version()}, {platform.python_implementation()}",
        *(f"{package}: {_version(package)}" for package in _PACKAGES),
        "",
        *(line.rstrip("\n") for line in traceback.format_exception(error)),
    ]
    return shown("\n".join(lines) + "\n")


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _write(text: str) -> str | None:
    """The name of the new file, in the working folder or else among temporary files; None when there is no place at all."""
    name = f"volid-fault-{datetime.now():%Y%m%dT%H%M%S}-{os.getpid()}.txt"
    for place in (Path(name), Path(tempfile.gettempdir()) / name):
        try:
            with place.open("x", encoding="utf-8") as file:
                file.write(text)
        except OSError:
            continue
        return str(place)
    return None
