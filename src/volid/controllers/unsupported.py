"""Controls that volid cannot write for, because no layout of their files was found in public sources, and what serves instead."""

from __future__ import annotations

NEUTRAL = "csv and hdf5 hold the same values with sign, units and datum in words"
EXCHANGE = "etalon and isg-volcomp are open texts with names of ISO 230-1 that other programs read; " + NEUTRAL

UNSUPPORTED: dict[str, str] = {
    "sinumerik-vcs": "no layout of its files was found in public sources; take sinumerik-cec, or etalon and the "
    "maker's own converter",
    "heidenhain-kcm": "no layout of its objects was found in public sources; take heidenhain-com or heidenhain-kinematicscomp",
    "okuma": f"no layout of its tables was found in public sources; {NEUTRAL}",
    "mazak": f"no layout of its tables was found in public sources; {NEUTRAL}",
    "haas": f"no layout of its tables was found in public sources; {NEUTRAL}",
    "mitsubishi": "its values are documented (increments, twice the difference in output units), but its parameter numbers "
    f"and files were not found in public sources; {NEUTRAL}",
    "rexroth-mtx": f"no layout of its tables was found in public sources; {NEUTRAL}",
    "br": f"no layout of its tables was found in public sources; {NEUTRAL}",
    "fagor": f"no layout of its volumetric tables was found in public sources; {NEUTRAL}",
    "num": f"no layout of its tables was found in public sources; {NEUTRAL}",
    "aerotech": f"no layout of its calibration files was found in public sources; {NEUTRAL}",
    "acs": f"no layout of its tables was found in public sources; {NEUTRAL}",
    "qif": f"no element for the errors of a machine's axes was found in its schema; {EXCHANGE}",
    "mtconnect": f"no element for the errors of a machine's axes was found in its schema; {EXCHANGE}",
    "dmis": f"no element for the errors of a machine's axes was found in it; {EXCHANGE}",
    "step-nc": f"no element for the errors of a machine's axes was found in ISO 10303-238; {EXCHANGE}",
    "grbl": "it has no table; correct the program instead (volid apply)",
    "marlin": "it has no table but skew; correct the program instead (volid apply)",
    "klipper": "it has no table but skew; correct the program instead (volid apply)",
}


def reason(name: str) -> str:
    """Why there is nothing for a control of that name, and what serves instead; "" where nothing is known of it."""
    plain = name.lower().replace("_", "-").replace("&", "")
    return next((text for known, text in UNSUPPORTED.items() if plain == known or plain.startswith(f"{known}-")), "")
