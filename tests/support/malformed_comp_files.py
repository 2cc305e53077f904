"""Tables of LinuxCNC that are not as it wants them: what it does with them in silence, and what volid says."""

from typing import NamedTuple

ROWS = ["0 0.010 0.010", "100 0.020 0.020", "200 0.050 0.050"]
GOOD, CONSTANT, BACKLASH = (0.015, 0.035, 0.050), (0.010,) * 3, (0.002,) * 3  # at 50, 150 and 260, all in +


class Malformed(NamedTuple):
    """A file of type 1, the corrections of LinuxCNC at 50, 150 and 260, and what volid says; None: it reads it the same."""

    content: bytes
    found: tuple[float, ...]
    message: str | None


def text(lines: list[str], end: str = "\n") -> bytes:
    return (end.join(lines) + end).encode()


CASES = {
    "a heading": Malformed(
        text(["# nominal trim trim", *ROWS]), BACKLASH, "line 1: '# nominal trim trim'.*takes? the table for empty"
    ),
    "a blank line": Malformed(text([ROWS[0], "", *ROWS[1:]]), CONSTANT, "line 2: 'blank'.*use the 1 row"),
    "decimal commas": Malformed(text([r.replace(".", ",") for r in ROWS]), BACKLASH, "line 1: .*decimal point"),
    "a byte order mark": Malformed(b"\xef\xbb\xbf" + text(ROWS), BACKLASH, "byte order mark"),
    "a row that falls": Malformed(text([*ROWS[:2], "50 0.099 0.099", ROWS[2]]), GOOD, "line 3: position 50 after 100"),
    "257 rows": Malformed(
        text([f"{x} {1e-3 * x:.3f} {1e-3 * x:.3f}" for x in range(257)]), (0.050, 0.150, 0.255), "257 rows"
    ),
    "returns alone": Malformed(text(ROWS, "\r"), CONSTANT, "line 1"),
    "words behind": Malformed(text([f"{r} measured" for r in ROWS]), GOOD, None),
    "two line ends": Malformed(text(ROWS, "\r\n"), GOOD, None),
}
