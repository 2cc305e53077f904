"""Displacements along beams that contradict the commanded positions: the beam's direction, sign, unit, and deviations instead."""

from __future__ import annotations

import numpy as np

from volid.exceptions import InputError
from volid.observations.beam_lines import FLAT, BeamLine

UNITS = {1e-3: "metres", 1e3: "micrometres", 1.0 / 25.4: "inches"}
BESIDE = {FLAT: 300.0, "retro": 20.0}  # mm that the tool may be beside the beam before the mirror has lost it
ON_BEAM = 0.1  # mm across a beam: less shows no angle
TURNED = 1e-2  # that a flat mirror may turn nominally along its line, as a sine
INCLINED = 0.995  # cosine: positions that run more obliquely are meant to
NOTICED = 0.5  # of u, by which a displacement may be too short because of the direction's digits
SHORT = 1.0  # mm: shorter displacements tell neither sign nor unit
LARGEST, SHARE = 1.0, 0.003  # mm, and of the displacement: how far readings may be from the commanded positions
FITS = 0.1  # of a displacement: how near readings in another unit, or of the other sign, come to the commanded ones


def check_beam(line: BeamLine) -> None:
    """Raises `InputError` where the tool nominally leaves the beam, or a flat mirror on it turns away."""
    limit = BESIDE[str(line.observations.options["mirror"])]
    i = int(np.argmax(line.beside))
    if line.beside[i] > limit:
        raise InputError(
            f"{line.seen.where(i)}: the position is {line.beside[i]:.3g} mm beside the beam of line '{line.name}', "
            f"which runs along [{_listed(line.beam.along)}]{_really(line)}; expected at most {limit:g} mm with mirror = "
            f"'{line.observations.options['mirror']}'. Mend the direction in lines, the point of the beam, or the positions "
            "(sense, order and unit of the columns)"
        )
    if line.mirrored:
        turned = line.turned @ line.normals[0]
        off = np.linalg.norm(turned - line.beam.along, axis=1)
        i = int(np.argmax(off))
        if off[i] > TURNED:
            raise InputError(
                f"{line.seen.where(i)}: a rotary axis turns the flat mirror by {np.rad2deg(off[i]):.3g}° from the beam of line "
                f"'{line.name}'; expected the same rotary positions along a line, or another line for others"
            )


def check_direction(line: BeamLine) -> None:
    """Raises `InputError` where positions on one straight line run a little beside the direction that is stated of the beam.

    A direction of two digits makes displacements that are compared with it 10 µm/m too short, and nothing else shows that.
    """
    moved = line.places - line.places[0]
    far = moved[int(np.argmax(np.linalg.norm(moved, axis=1)))]
    size = float(np.linalg.norm(far))
    if size <= SHORT or np.linalg.norm(np.cross(moved, far / size), axis=1).max() > ON_BEAM:
        return
    cosine = float(far @ line.beam.along) / size
    short = (1.0 - abs(cosine)) * size
    if abs(cosine) > INCLINED and short > NOTICED * line.seen.u.min():
        digits = ", ".join(f"{c + 0.0:.6f}" for c in np.sign(cosine) * far / size)
        raise InputError(
            f"{line.observations.file_and_set}: line '{line.name}' is said to run along [{_listed(line.beam.along)}], while its "
            f"positions run along [{digits}]: displacements would be taken to be {1e3 * short:.2g} µm too short. State the "
            "direction with all digits; if the beam really was inclined, state misalignment = true and misalignment_u (rad)"
        )


def check_beside(line: BeamLine) -> None:
    """Raises `InputError` where no reading stands beside the others across the beam, so that nothing shows its angles."""
    across = line.places @ line.frame[1:].T
    if np.ptp(across, axis=0).max() < ON_BEAM:
        raise InputError(
            f"{line.observations.file_and_set}: all positions of line '{line.name}' lie on its beam, where unknown angles act by "
            "the cosine error alone and cannot be found. Leave them known and state an effect with type = 'scale', per = 'line' "
            "and u = 5e-7 (for 1 mrad), or state misalignment_u (rad)"
        )


def _really(line: BeamLine) -> str:
    """Where the positions go from the first row to the one farthest from it, in words; "" where they go nowhere."""
    moved = line.places - line.places[0]
    far = moved[int(np.argmax(np.linalg.norm(moved, axis=1)))]
    size = float(np.linalg.norm(far))
    return f", while positions go along [{_listed(far / size)}]" if size > SHORT else ""


def _listed(vector: np.ndarray) -> str:
    return ", ".join(f"{c + 0.0:.4g}" for c in vector)


def check_displacements(line: BeamLine, own: np.ndarray) -> None:
    """Raises `InputError` for displacements of rows `own` of a line that have another sign or unit, or are deviations."""
    nominal, found = line.nominal[own], line.seen.readings[own, 0]
    travel, left = float(np.ptp(nominal)), found - nominal
    off = np.abs(left - np.median(left))
    if off.max() <= max(LARGEST, SHARE * travel):
        return
    i = int(np.argmax(off))
    where = f"{line.seen.where(int(np.flatnonzero(own)[i]))}, line '{line.name}'"
    if travel <= SHORT:
        raise InputError(
            f"{where}: the tool does not move along the beam, but displacement is {off[i]:.3g} mm from the others; is it in µm? "
            "Expected mm. If the machine's errors are that large, pass `accept_large_errors=True`"
        )
    slope = float(np.polyfit(nominal - nominal[0], found, 1)[0])
    cures = {1.0: "", **{factor: unit for factor, unit in UNITS.items()}}
    for factor, unit in cures.items():
        for sign in (1.0, -1.0):
            if abs(slope / (sign * factor) - 1.0) < FITS and (sign * factor != 1.0):
                raise InputError(f"{where}: {_contradiction(line, sign, unit)}")
    if abs(slope) < FITS and np.ptp(found) < max(LARGEST, FITS * travel):
        raise InputError(
            f"{where}: displacements change by {np.ptp(found):.3g} mm while the tool moves by {travel:.4g} mm; they seem to be "
            "deviations. Expected the whole displacement: add the commanded one"
        )


def _contradiction(line: BeamLine, sign: float, unit: str) -> str:
    said = f"displacements seem to be in {unit}; expected mm" if unit else ""
    if sign > 0.0:
        return said
    along = f"[{_listed(line.beam.along)}]"
    turned = (
        f"displacements decrease where the tool moves along {along}; negate them, or turn the direction of the line round (or, "
        "if an axis counts the other way, its column)"
    )
    return f"{turned}; {said}" if said else turned
