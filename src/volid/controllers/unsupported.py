"""Controls that volid cannot write for: because no layout of their files is public, and what serves instead."""

from __future__ import annotations

NEUTRAL = "csv and hdf5 hold the same values with sign, units and datum in words"

UNSUPPORTED: dict[str, str] = {
    "sinumerik-vcs": "the layout of its files is not public; take sinumerik-cec, or etalon for the maker's own converter",
    "heidenhain-kcm": "the layout of its objects is not public; take heidenhain-com or heidenhain-kinematicscomp",
    "okuma": f"no layout of its tables is public; {NEUTRAL}",
    "mazak": f"no layout of its tables is public; {NEUTRAL}",
    "haas": f"no layout of its tables is public; {NEUTRAL}",
    "mitsubishi": "its values are public (increments, twice the difference in output units), its parameter numbers are not; "
    "take fanuc-pitch for the order of the increments, or csv",
    "rexroth-mtx": f"no layout of its tables is public; {NEUTRAL}",
    "br": f"no layout of its tables is public; {NEUTRAL}",
    "fagor": f"no layout of its volumetric tables is public; {NEUTRAL}",
    "num": f"no layout of its tables is public; {NEUTRAL}",
    "aerotech": f"no layout of its calibration files is public; {NEUTRAL}",
    "acs": f"no layout of its tables is public; {NEUTRAL}",
    "grbl": "it has no table; correct the program instead (volid apply)",
    "marlin": "it has no table but skew; correct the program instead (volid apply)",
    "klipper": "it has no table but skew; correct the program instead (volid apply)",
}


def reason(name: str) -> str:
    """Why there is nothing for a control of that name, and what serves instead; "" where nothing is known of it."""
    plain = name.lower().replace("_", "-").replace("&", "")
    return next((text for known, text in UNSUPPORTED.items() if plain == known or plain.startswith(f"{known}-")), "")
