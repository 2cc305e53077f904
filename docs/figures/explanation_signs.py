"""The sign of squareness errors: three positive values, three angles."""

from matplotlib.figure import Figure

from volid.report.language import ENGLISH
from volid.report.plot.constants import Constant
from volid.report.plot.squareness import angle, angle_panel, sketch_panels


def draw() -> Figure:
    """EC0Y, EB0Z and EA0Z of + 20 µrad."""
    figure, panels = sketch_panels(1, 3)
    for panel, name in zip(panels, ("EC0Y", "EB0Z", "EA0Z"), strict=True):
        angle_panel(panel, angle(Constant(name, 20e-6, 2e-6)), ENGLISH)
    return figure
