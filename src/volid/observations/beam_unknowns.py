"""What is unknown of beams: an offset for every uninterrupted one, and the angles of a beam or of the flat mirror at its end."""

from __future__ import annotations

import numpy as np

from volid.observations.base import NuisanceTable
from volid.observations.beam_lines import BeamLine
from volid.observations.response import TOOL_VECTORS, DirectionOf, Response, TurnOf, as_rows

SPREAD = {"offset": 0.1, "angle": 1e-3}  # mm, rad: of a virtual instrument


def segments(line: BeamLine) -> list[tuple[str, np.ndarray]]:
    """Names of the segments of a line, and which of its rows are theirs."""
    labels = line.seen.labels["segment"]
    return [(str(name), labels == name) for name in dict.fromkeys(labels.tolist())]


def offset_key(line: BeamLine, segment: str) -> tuple[str, ...]:
    return ("offset", line.observations.name, line.name, segment)


def angle_keys(line: BeamLine) -> tuple[tuple[str, ...], ...]:
    """Keys of the unknown angles of a line: three that beams share, two of its own, or none."""
    options = line.observations.options
    if options.get("alignment"):
        return tuple(("alignment", str(options["alignment"]), c) for c in "ABC")
    return tuple(("beam", line.observations.name, line.name, c) for c in "12") if options["misalignment"] else ()


def offset_slots(line: BeamLine, table: NuisanceTable) -> np.ndarray:
    """Number of the offset of every row of a line, (m,)."""
    response, found = line.offset_response(angle_keys(line)), np.zeros(len(line.rows), dtype=np.int64)
    several = len(segments(line)) > 1
    for segment, own in segments(line):
        name = f"offset {line.observations.name} line {line.name}" + (f" segment {segment}" if several else "")
        found[own] = table.index(offset_key(line, segment), name, spread=SPREAD["offset"], response=response)
    return found


def angle_slots(line: BeamLine, table: NuisanceTable) -> list[int]:
    """Numbers of the unknown angles of a line."""
    keys, found = angle_keys(line), []
    body, frame = (TOOL_VECTORS, line.normals) if line.mirrored else (line.on, line.frame)
    for i, key in enumerate(keys):
        response: Response
        if len(keys) == 3:
            name, response = " ".join(key), TurnOf(body, of=keys, component=i, sense=1.0)
        else:
            what = "mirror" if line.mirrored else "beam"
            name = f"{what} {line.observations.name} line {line.name} angle {key[-1]}"
            response = DirectionOf(body, of=keys, component=i, frame=as_rows(frame))
        known_u = float(line.observations.options["misalignment_u"])
        found.append(table.index(key, name, "rad", prior_u=known_u, spread=SPREAD["angle"], response=response))
    return found
