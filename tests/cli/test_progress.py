"""What a long command says of its progress: stages, remaining time, one line on a terminal, few lines elsewhere."""

import io
import sys
import time

import pytest

from volid.backend.steps import Step
from volid.cli.progress import PATIENCE, SPARSE, Progress
from volid.cli.remaining import Remaining, left_words
from volid.cli.streams import Escaped, TransientLine


class Clock:
    """A clock that goes on when it is told to."""

    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


class Terminal(io.StringIO):
    """What a terminal of one line would show, and everything that was written."""

    def isatty(self):
        return True

    @property
    def line(self):
        """The line that the reader sees: what stands behind the last return, over what was there before."""
        seen = ""
        for part in self.getvalue().split("\n")[-1].split("\r"):
            seen = part + seen[len(part) :]
        return seen.rstrip()


def on_a_terminal(monkeypatch):
    """Standard error as a terminal of 60 columns, for a test in whose body it is called."""
    monkeypatch.setenv("COLUMNS", "60")
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", Escaped(stream, TransientLine(stream)))
    return stream


def test_speaks_after_a_second_only(capsys):
    with Progress() as progress:
        progress("quick")
    time.sleep(1.2 * PATIENCE)
    assert capsys.readouterr().err == ""
    with Progress() as progress:
        progress("slow")
        time.sleep(1.3 * PATIENCE)
        assert capsys.readouterr().err == "volid: slow\n"
        progress("next")
    assert capsys.readouterr().err == "volid: next\n"


def test_few_lines_where_nobody_watches(capsys):
    clock = Clock()
    with Progress(clock) as progress:
        progress.tick()
        progress("reading")
        for done in range(1, 101):
            clock.now += 1.0
            progress(Step(done, 100, "trials"))
    lines = capsys.readouterr().err.splitlines()
    assert lines[:2] == ["volid: reading", "volid: 1 of 100 trials (1 %)"]
    assert lines[2] == "volid: 11 of 100 trials (11 %), about 90 s left"
    assert lines[-1].startswith("volid: 100 of 100 trials (100 %)")
    assert len(lines) == 2 + 99 / SPARSE // 1 + 1
    assert all("\r" not in line for line in lines)


def test_one_line_on_a_terminal_that_vanishes(monkeypatch):
    terminal, clock = on_a_terminal(monkeypatch), Clock()
    with Progress(clock) as progress:
        progress("a rather long stage of the work")
        assert terminal.line == "volid: a rather long stage of the work"
        for done in range(1, 41):
            clock.now += 0.25
            progress(Step(done, 400, "campaigns"))
        assert terminal.line.startswith("volid: 37 of 400 campaigns (9 %), about 90 s left")
        print("a warning", file=sys.stderr)
        progress.tick()
        assert terminal.line.startswith("volid: 40 of 400")
    assert terminal.line == ""
    *before, warning = terminal.getvalue().split("\n")[-2].split("\r")
    assert warning == "a warning" and set(before[-1]) == {" "}
    assert terminal.getvalue().count("volid: ") <= 2 + 40 * 0.25 / PATIENCE + 1


def test_the_line_fits_the_terminal_and_obeys_nothing(monkeypatch):
    terminal = on_a_terminal(monkeypatch)
    with Progress(Clock()) as progress:
        progress("set \x1b[2J " + 100 * "x")
        assert len(terminal.line) == 59 and terminal.line.endswith("…") and "\x1b" not in terminal.getvalue()


def test_remaining_time_of_even_steps_is_exact():
    """k steps of s seconds each: (n - k) s remain; what came before the first step does not count."""
    left = Remaining()
    left.take("compiling", 0.0)
    for k in range(1, 21):
        left.take(Step(5 * k, 200, "trials"), 100.0 + 3.0 * k)
        expected = None if 3.0 * (k - 1) < 2.0 else 3.0 * (40 - k)
        assert left.seconds(100.0 + 3.0 * k) == (None if expected is None else pytest.approx(expected))


def test_resumed_work_does_not_make_it_look_fast():
    left = Remaining()
    left.take(Step(900, 1000, "trials"), 0.0)
    left.take(Step(910, 1000, "trials"), 60.0)
    assert left.seconds(60.0) == pytest.approx(540.0)


def test_a_step_that_takes_long_is_not_promised_to_end():
    left = Remaining()
    for k in (1, 2, 3):
        left.take(Step(k, 5, "types"), 10.0 * k)
    assert [left.seconds(30.0 + t) for t in (0.0, 5.0, 10.0, 1000.0)] == [20.0, 15.0, 10.0, 10.0]


def test_another_stage_has_a_speed_of_its_own():
    left = Remaining()
    for k in (1, 2, 3):
        left.take(Step(k, 5, "rows", of="solving"), 10.0 * k)
    left.take(Step(1, 5, "rows", of="residuals"), 31.0)
    assert left.seconds(31.0) is None
    for k in (2, 3):
        left.take(Step(k, 5, "rows", of="residuals"), 30.0 + 1.5 * k)
    assert left.seconds(34.5) == pytest.approx(3.5)
    left.take("writing", 40.0)
    assert left.seconds(40.0) is None


def test_uneven_steps_promise_no_end(capsys):
    """Sections of a page: each takes its own time."""
    clock = Clock()
    with Progress(clock) as progress:
        progress.tick()
        for k in range(1, 14):
            progress(Step.number(k, 13, "drawing, section"))
            clock.now += 4.0
    lines = [f"volid: drawing, section {k} of 13" for k in (1, 4, 7, 10, 13)]  # one in ten seconds
    assert capsys.readouterr().err.splitlines() == lines


def test_the_same_stage_again_starts_anew():
    """Every pass over a stream counts its rows from the beginning."""
    left = Remaining()
    for k in (1, 2, 3):
        left.take(Step(k, 3, "rows", of="solving"), 10.0 * k)
    left.take(Step(1, 3, "rows", of="solving"), 40.0)
    assert left.seconds(40.0) is None


def test_the_end_of_a_part_is_not_called_that_of_the_work(capsys):
    clock = Clock()
    with Progress(clock) as progress:
        progress.tick()
        for done in (1, 2, 3):
            clock.now += 20.0
            progress(Step(done, 5, "rows", of="solving"))
        for done in (1, 2, 3):
            clock.now += 20.0
            progress(Step(done, 5, "trials").within("this stage"))
    lines = capsys.readouterr().err.splitlines()
    assert lines[2] == "volid: solving: 3 of 5 rows (60 %), about 40 s left of this pass"
    assert lines[5] == "volid: 3 of 5 trials (60 %), about 40 s left of this stage"


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.0, "less than 10 s left"),
        (14.0, "about 10 s left"),
        (94.0, "about 90 s left"),
        (95.0, "about 2 min left"),
        (3599.0, "about 60 min left"),
        (5700.0, "about 1.5 h left"),
        (36000.0, "about 10 h left"),
    ],
)
def test_words(seconds, words):
    assert left_words(seconds) == words
