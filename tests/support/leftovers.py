"""What a test leaves behind in this process is found at once, named and put back: a test must not change what the next one sees.

Compared before the fixtures of a test are set up and after they are torn down; shared fixtures, too, must leave nothing.
"""

import os
import signal
import sys
from collections.abc import MutableMapping
from typing import Any

import pytest

# written by pytest for every test; by JAX and its compiler when they are imported
NOT_LEFT = ("PYTEST_CURRENT_TEST", "TF_CPP_MIN_LOG_LEVEL")
HANDLED = [s for s in (getattr(signal, n, None) for n in ("SIGINT", "SIGTERM", "SIGPIPE", "SIGHUP")) if s is not None]
BEFORE = pytest.StashKey[dict[str, dict[str, Any]]]()


def restore(mapping: MutableMapping, before: dict) -> None:
    """Make `mapping` what it was, touching what differs only."""
    for name in [name for name in mapping if name not in before]:
        del mapping[name]
    for name, value in before.items():
        if name not in mapping or mapping[name] != value:
            mapping[name] = value


def state() -> dict[str, dict[str, Any]]:
    """What a test could leave changed, by its place and name; of NumPy, JAX and matplotlib once they are loaded."""
    found = {
        "os.environ": {k: v for k, v in os.environ.items() if k not in NOT_LEFT},
        "process": {
            "working directory": os.getcwd(),
            "sys.path": frozenset(sys.path),  # pytest itself moves a package's folder to the front
            "profile": sys.getprofile(),
            "recursion limit": sys.getrecursionlimit(),
        },
        "signal": {s.name: signal.getsignal(s) for s in HANDLED},
    }
    if "numpy" in sys.modules:
        numpy = sys.modules["numpy"]
        found["numpy"] = numpy.get_printoptions() | numpy.geterr()
    if "jax" in sys.modules:
        found["jax.config"] = dict(sys.modules["jax"].config.values)
    if "matplotlib" in sys.modules:
        parameters = dict(sys.modules["matplotlib"].rcParams.copy())
        parameters.pop("backend", None)  # chosen when the first figure is made
        found["matplotlib.rcParams"] = parameters
    if "matplotlib.pyplot" in sys.modules:
        found["matplotlib"] = {"open figures": tuple(sys.modules["matplotlib.pyplot"].get_fignums())}
    return found


def changes(before: dict[str, dict[str, Any]], after: dict[str, dict[str, Any]]) -> list[str]:
    """What differs, in words; what was not loaded before is not compared."""
    words = []
    for place in before.keys() & after.keys():
        old, new = before[place], after[place]
        for name in sorted(old.keys() | new.keys()):
            was, now = old.get(name, "not set"), new.get(name, "not set")
            if was is not now and was != now:
                words.append(f"{place}: {name} was {was!r}, is {now!r}")
    return sorted(words)


def put_back(before: dict[str, dict[str, Any]]) -> None:
    """The environment, working directory, path and signals of before; what else was left is only named."""
    restore(os.environ, before["os.environ"] | {k: os.environ[k] for k in NOT_LEFT if k in os.environ})
    os.chdir(before["process"]["working directory"])
    sys.path[:] = [folder for folder in sys.path if folder in before["process"]["sys.path"]]
    for name, handler in before["signal"].items():
        if handler is not None:  # set outside Python
            signal.signal(getattr(signal, name), handler)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item):
    item.stash[BEFORE] = state()
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item):
    result = yield
    left = changes(item.stash[BEFORE], state())
    if left:
        put_back(item.stash[BEFORE])
        pytest.fail("left to the next test: " + "; ".join(left), pytrace=False)
    return result
