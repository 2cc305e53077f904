"""What the command line sets up before a verb runs: quiet logs, a cache of compiled programs."""

from __future__ import annotations

import logging
import os
from contextlib import suppress
from pathlib import Path


def version() -> str:
    """The installed version of volid."""
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as installed

    try:
        return installed("volid")
    except PackageNotFoundError:
        return "(not installed)"


def prepare() -> None:
    """Set up the logs and the cache; to be called before JAX is imported."""
    logging.getLogger("jax._src.xla_bridge").setLevel(logging.ERROR)
    with suppress(RuntimeError):  # no home folder: compile every time
        cache_programs(cache_folder())


def cache_folder() -> Path:
    """The user's cache folder for compiled programs, on Windows under LOCALAPPDATA, else under XDG_CACHE_HOME or ~/.cache."""
    if os.name == "nt":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "volid" / "jax"


def cache_programs(folder: Path) -> None:
    """Let JAX keep its compiled programs in `folder` between runs: compiling takes longer than most fits.

    Explicit settings win; a folder that cannot be written is not used.
    """
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            return
        os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
