"""A five-axis machine drawn from its structural code."""

from pathlib import Path

from matplotlib.figure import Figure

import volid

MODEL = Path(__file__).parents[2] / "models" / "wCAYXbZt_trunnion.toml"


def draw() -> Figure:
    """The machine with a tool of 150 mm."""
    return volid.plot.machine_figure(volid.load_machine(MODEL), (0.0, 0.0, -150.0))
