"""Standard output and standard error of a command: always open, and safe for a terminal whatever is printed on them."""

from __future__ import annotations

import argparse
import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from typing import Any, TextIO

from volid.exceptions import InputError, shown

STANDARD_OUTPUT = "/dev/stdout"
_NAMES = ("-", STANDARD_OUTPUT, "/dev/fd/1", "/proc/self/fd/1")
_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF}


class Escaped:
    """A stream on which control characters of foreign names appear escaped, \\x1b for ESC; all else is that of the stream."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write the text as it may be shown."""
        self._stream.write(shown(text))
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
    out, err = Escaped(sys.stdout), Escaped(sys.stderr)
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
    """With `-o -` or `-o /dev/stdout` the output alone goes there, and all words to standard error.

    Raises `InputError` when --json wants standard output too.
    """
    if getattr(args, "output", None) not in _NAMES:
        yield
        return
    if getattr(args, "json", False):
        raise InputError(f"-o {args.output} and --json both write to standard output; leave one out")
    args.output = STANDARD_OUTPUT
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
