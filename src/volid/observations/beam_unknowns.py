"""What is unknown of beams: an offset for every uninterrupted one, and the angles of a beam or of the flat mirror at its end."""

from __future__ import annotations

import numpy as np

from volid.campaign import ObservationSet
from volid.observations.base import NuisanceTable
from volid.observations.beam_lines import BeamLine
from volid.observations.response import TOOL_VECTORS, DirectionOf, Key, Response, TurnOf, as_rows

LINE, RUN = "line", "run"  # what has an offset of its own
# mm, rad: of a virtual instrument; a flat mirror that stands off its beam by more than about 0.1 mrad loses it
SPREAD = {"offset": 0.1, "beam": 1e-3, "mirror": 2e-5}


def counted_by(observations: ObservationSet) -> tuple[str, ...]:
    """Labels of an uninterrupted beam, which has one offset."""
    return ("line", "segment") if observations.options.get("offset_per", LINE) == LINE else ("line", RUN, "segment")


def offset_keys(observations: ObservationSet) -> list[Key]:
    """Key of the offset of every row."""
    columns = [observations.labels[label].tolist() for label in counted_by(observations)]
    return [("offset", observations.name, *map(str, names)) for names in zip(*columns, strict=True)]


def uninterrupted(line: BeamLine) -> list[tuple[Key, np.ndarray]]:
    """Keys of the offsets of a line, and which of its rows are theirs."""
    keys = offset_keys(line.seen)
    return [(key, np.array([k == key for k in keys])) for key in dict.fromkeys(keys)]


def angle_keys(line: BeamLine) -> tuple[tuple[str, ...], ...]:
    """Keys of the unknown angles of a line: three that beams share, two of its own, or none."""
    options = line.observations.options
    if options.get("alignment"):
        return tuple(("alignment", str(options["alignment"]), c) for c in "ABC")
    return tuple(("beam", line.observations.name, line.name, c) for c in "12") if options["misalignment"] else ()


def offset_slots(line: BeamLine, table: NuisanceTable) -> np.ndarray:
    """Number of the offset of every row of a line, (m,)."""
    response, found = line.offset_response(angle_keys(line)), np.zeros(len(line.rows), dtype=np.int64)
    parts, labels = uninterrupted(line), counted_by(line.observations)
    for key, own in parts:
        words = [f" {label} {name}" for label, name in zip(labels, key[2:], strict=True)]
        name = f"offset {line.observations.name}{''.join(words if len(parts) > 1 else words[:1])}"
        found[own] = table.index(key, name, spread=SPREAD["offset"], response=response)
    return found


def angle_slots(line: BeamLine, table: NuisanceTable) -> list[int]:
    """Numbers of the unknown angles of a line."""
    keys, found = angle_keys(line), []
    body, frame = (TOOL_VECTORS, line.normals) if line.mirrored else (line.on, line.frame)
    what = "mirror" if line.mirrored and len(keys) < 3 else "beam"
    for i, key in enumerate(keys):
        response: Response
        if len(keys) == 3:
            name, response = " ".join(key), TurnOf(body, of=keys, component=i, sense=1.0)
        else:
            name = f"{what} {line.observations.name} line {line.name} angle {key[-1]}"
            response = DirectionOf(body, of=keys, component=i, frame=as_rows(frame))
        known_u = float(line.observations.options["misalignment_u"])
        found.append(table.index(key, name, "rad", prior_u=known_u, spread=SPREAD[what], response=response))
    return found
