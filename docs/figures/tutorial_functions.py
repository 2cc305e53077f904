"""The 18 error functions of the tutorial's machine."""

from _tutorial import solution
from matplotlib.figure import Figure

import volid


def draw() -> Figure:
    """Small multiples with bands of U."""
    return volid.plot.error_functions(solution())
