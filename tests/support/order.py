"""The order of the tests: quick ones before slow ones, each file on one worker; with --shuffle SEED, files and tests at random.

One command runs both parts, and says between them how the first went. What a test leaves to the next shows in another order.
"""

import random
import time

import pytest

LIVE = "linuxcnc"


def pytest_addoption(parser):
    parser.addoption("--shuffle", type=int, metavar="SEED", help="run files, and the tests of each, in a random order")


def is_slow(item) -> bool:
    return item.get_closest_marker("slow") is not None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Long statistics take the time they take; the tests of a file share fixtures and compiled programs: one worker for both."""
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.timeout(0))
        part = "slow" if is_slow(item) else "quick"
        item.add_marker(pytest.mark.xdist_group(f"{together(item)} {part}"))


def together(item) -> str:
    """What runs on one worker: the tests of a file; all that start LinuxCNC, of which one can run on a computer."""
    return LIVE if item.path.parent.name == LIVE else item.path.stem


class LastWord:
    """Orders the tests when pytest has grouped them by their fixtures."""

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config, items):
        seed = config.getoption("--shuffle")
        if seed is not None:
            shuffle(items, seed)
        items.sort(key=is_slow)


def shuffle(items: list, seed: int) -> None:
    """Files in random order, and within each its tests."""
    draw = random.Random(seed)
    files: dict = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    paths = list(files)
    draw.shuffle(paths)
    for path in paths:
        draw.shuffle(files[path])
    items[:] = [item for path in paths for item in files[path]]


class Parts:
    """Says, when the first slow test has run, how long the quick ones took and how many of them failed."""

    def __init__(self, terminal) -> None:
        self._terminal, self._begin = terminal, time.monotonic()
        self._quick = self._failed = 0
        self._said = False

    def pytest_runtest_logreport(self, report):
        if "slow" in report.keywords:
            if self._quick and not self._said:
                self._say("slow tests follow")
            self._said = True
        elif report.when == "call" or report.failed:
            self._quick += report.when == "call"
            self._failed += report.failed

    def _say(self, what: str) -> None:
        minutes = (time.monotonic() - self._begin) / 60
        self._terminal.ensure_newline()
        self._terminal.write_line(f"quick tests: {self._quick} run, {self._failed} failed, {minutes:.1f} min; {what}")


def pytest_configure(config):
    config.pluginmanager.register(LastWord(), "order of tests")
    terminal = config.pluginmanager.getplugin("terminalreporter")
    if terminal is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Parts(terminal), "parts of the tests")
