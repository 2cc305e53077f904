"""Standard output and standard error of a command: always open, and safe for a terminal whatever is printed on them."""

from __future__ import annotations

import argparse
import errno
import io
import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from typing import Any, TextIO

from volid.exceptions import InputError, cut, shown

STANDARD_OUTPUT = "/dev/stdout"
_NAMES = ("-", STANDARD_OUTPUT, "/dev/fd/1", "/proc/self/fd/1")
_CALLED_BY_PATH = re.compile(rf"(?<![\w./]){STANDARD_OUTPUT}(?![\w/]|\.\w)")
_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF}


class TransientLine:
    """A line at the bottom of a terminal that is written over and over, and gives way to whatever else is written.

    Args:
        stream: A terminal.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._length = stream, 0

    @classmethod
    def of(cls, stream: Any) -> TransientLine:
        """That of a stream that escapes, or a new one of another stream."""
        return stream.transient if isinstance(stream, Escaped) else cls(stream)

    def show(self, text: str) -> None:
        """Write the text in place of the one before, cut to the width of the terminal."""
        line = cut(shown(text), max(shutil.get_terminal_size().columns - 1, 20))
        with suppress(OSError, ValueError):  # a terminal that has gone is no reason to stop the work
            self._stream.write(f"\r{line.ljust(self._length)}")
            self._stream.flush()
        self._length = len(line)

    def clear(self) -> None:
        """Take the text away."""
        if self._length:
            with suppress(OSError, ValueError):
                self._stream.write(f"\r{' ' * self._length}\r")
                self._stream.flush()
        self._length = 0


class Escaped:
    """A stream on which control characters of foreign names appear escaped, \\x1b for ESC; all else is that of the stream.

    Args:
        stream: The stream.
        transient: The line at the bottom of the terminal, taken away before anything is written.
    """

    def __init__(self, stream: TextIO, transient: TransientLine) -> None:
        self._stream, self.transient = stream, transient
        self.names_output = False  # whether the output goes to standard output, which words then call so

    def write(self, text: str) -> int:
        """Write the text as it may be shown."""
        self.transient.clear()
        self._stream.write(_CALLED_BY_PATH.sub("standard output", shown(text)) if self.names_output else shown(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def streams() -> Iterator[None]:
    """Within, both streams are there and escape. A standard output that was closed ends the command as a closed pipe does."""
    if sys.stdout is None:
        sys.stdout = _without_reader()
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        _set_up(stream)
    transient = TransientLine(sys.stderr)
    out, err = Escaped(sys.stdout, transient), Escaped(sys.stderr, transient)
    with redirect_stdout(out), redirect_stderr(err):  # type: ignore[type-var]
        yield


def _set_up(stream: TextIO) -> None:
    """UTF-8 for files, as every text file is, also one that the shell makes of the output; what a terminal lacks is replaced."""
    if isinstance(stream, io.TextIOWrapper):
        if stream.isatty():
            stream.reconfigure(errors="replace")
        else:
            stream.reconfigure(encoding="utf-8")


def _without_reader() -> TextIO:
    """A pipe that nobody reads, at descriptor 1, where the next file opened would otherwise stand."""
    reader, writer = os.pipe()
    for descriptor in {reader, writer} - {1}:
        if descriptor == writer:
            os.dup2(writer, 1)
        os.close(descriptor)
    return open(1, "w", encoding="utf-8", closefd=False)


@contextmanager
def output_on_standard_output(args: argparse.Namespace) -> Iterator[None]:
    """With `-o -` or `-o /dev/stdout` the output alone goes there, and all words, which call it so, to standard error.

    Raises `InputError` when --json wants standard output too.
    """
    if getattr(args, "output", None) not in _NAMES:
        yield
        return
    if getattr(args, "json", False):
        raise InputError(f"-o {args.output} and --json both write to standard output; leave one out")
    args.output = STANDARD_OUTPUT
    if isinstance(sys.stderr, Escaped):
        sys.stderr.names_output = True  # for messages after this block too
    sys.stdout.flush()
    with redirect_stdout(sys.stderr):
        yield


def silence() -> None:
    """Let what is still to be written to the streams vanish, so that Python does not complain at its end."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
            continue
        with suppress(OSError, ValueError, AttributeError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)


def is_of_a_stream(error: Exception) -> bool:
    """Whether a stream or an open file could not take more: its reader has gone, the disk is full, the descriptor was closed."""
    return isinstance(error, BrokenPipeError) or (
        isinstance(error, OSError) and error.filename is None and error.errno in _NO_ROOM
    )
