"""Which codes of RS274/NGC are followed, which pass through, and which are refused, each with what to do instead.

Codes are kept as ten times their number, because some have a digit behind the point (G59.1 is 591). Of a code that stands in no
table nothing is known, and it is refused.

Sources: ISO 6983-1:2009, table 3; the NIST RS274/NGC Interpreter, version 3 (NISTIR 6556, 2000), 3.5 and table 4, also for
the order in which the codes of one block act.
"""

from __future__ import annotations

MOTION, PLANE, DISTANCE, CENTRES, UNITS, FEED, SYSTEM, LENGTH, PATH, OTHER, ALONE, NOTHING = (
    "motion", "plane", "distance mode", "mode of arc centres", "units", "feed mode", "work offset", "tool length offset",
    "path mode", "spindle mode", "non-modal", "cancel",
)  # fmt: skip

GROUPS = {
    **dict.fromkeys((0, 10, 20, 30, 800), MOTION),
    **dict.fromkeys((170, 180, 190), PLANE),
    **dict.fromkeys((900, 910), DISTANCE),
    **dict.fromkeys((901, 911), CENTRES),
    **dict.fromkeys((200, 210), UNITS),
    **dict.fromkeys((930, 940, 950), FEED),
    **dict.fromkeys((540, 550, 560, 570, 580, 590, 591, 592, 593), SYSTEM),
    **dict.fromkeys((430, 490), LENGTH),
    **dict.fromkeys((610, 611, 640), PATH),
    **dict.fromkeys((970,), OTHER),
    **dict.fromkeys((40, 530, 280, 300), ALONE),
    **dict.fromkeys((80, 150, 400, 690, 980, 990), NOTHING),
}
"""Group of each code that is followed or passes through; two codes of one group in a block contradict each other."""

_ORIGIN = "moves the origin while the program runs; leave it out, and state the work offsets by `offset`"
_CYCLE = "is a canned cycle, whose motions the control makes; let the post-processor write them as G0 and G1"
_CUTTER = (
    "is cutter compensation, which makes another path of this one; let the post-processor write the tool's centre path"
)
_CALL = "calls a subprogram or a macro; let the post-processor write the motions themselves"
_PROBE = "ends where the probe touches, which the program does not say; run probing uncorrected"
_FRAME = "turns, mirrors or scales coordinates; let the post-processor write them as they are in the end"
_CURVE = "is a spline, which is not followed; let the post-processor write lines and arcs"
_THREAD = "is tied to the spindle's turns; let the program do it in a part of its own, uncorrected"
_LATHE = "is for lathes, whose diameters and constant surface speed are not followed"

REFUSED = {
    **dict.fromkeys((100, 520, 920, 921, 922, 923), _ORIGIN),
    **dict.fromkeys((730, 740, 760, 810, 820, 821, 830, 831, 840, 850, 860, 870, 880, 890, 811), _CYCLE),
    **dict.fromkeys((410, 411, 420, 421), _CUTTER),
    **dict.fromkeys((650, 660, 670), _CALL),
    **dict.fromkeys((310, 382, 383, 384, 385, 386), _PROBE),
    **dict.fromkeys((510, 500, 501, 511, 680, 160, 682), _FRAME),
    **dict.fromkeys((50, 51, 52, 53, 61, 62), _CURVE),
    **dict.fromkeys((320, 330, 331, 332), _THREAD),
    **dict.fromkeys((70, 960), _LATHE),
    **dict.fromkeys(
        (431, 432, 433, 434, 440, 435), "is a tool length offset that is not followed; write G43 with H, or G49"
    ),
    **dict.fromkeys((120, 130, 121, 131), "makes a pocket of its own; let the post-processor write lines and arcs"),
    **dict.fromkeys((281, 301), "stores a place while the program runs; leave it out"),
}
"""Codes that are known and refused: what they are and what to do."""

ENDS = (0.0, 1.0, 2.0, 30.0, 60.0)
"""M codes that act after the motion of their block."""
PAUSES = frozenset({0.0, 1.0, 60.0})
"""M codes after which a person may have moved the axes."""
BEFORE = (3.0, 4.0, 7.0, 8.0)
"""M codes that act before the motion of their block, on every control."""
PASSING = frozenset({*ENDS, *BEFORE, 5.0, 6.0, 9.0, 19.0, 48.0, 49.0, 50.0, 51.0, 52.0, 53.0, 61.0})
"""M codes that pass through."""
_SUB = "calls or ends a subprogram; let the post-processor write the motions themselves"
M_REFUSED = {98.0: _SUB, 99.0: _SUB, 97.0: _SUB}

LETTERS = {
    **dict.fromkeys(
        "ABCUVW",
        "is a word of a rotary or a parallel axis; programs of X, Y and Z are corrected, with other axes clamped",
    ),
    "D": "is a word of cutter compensation; let the post-processor write the tool's centre path",
    "E": "is a word whose meaning differs from control to control; leave it out",
    "L": "repeats something; let the post-processor write it out",
    "O": "names or calls a subprogram; let the post-processor write the motions themselves",
}
"""Letters that are refused, and why."""
