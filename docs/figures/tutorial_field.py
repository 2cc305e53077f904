"""The deviation of the tutorial's machine before compensation, with positioning tables, and with a volumetric grid."""

from _field import field_figure
from _tutorial import solution
from matplotlib.figure import Figure


def draw() -> Figure:
    """Three lattices at one scale."""
    return field_figure(solution(), ([], ["L-POS"], ["L-VOL"]))
