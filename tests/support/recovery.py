"""What recoveries of three-axis machines are judged by: points and limits."""

from functools import cache

import numpy as np
from exact_chain import default_tools
from scipy.stats import qmc

from support.machines import MACHINES

LARGEST = {"vertical": 0.5e-3, "gantry": 0.7e-3, "horizontal": 0.5e-3}  # 3-D root mean square, mm
TOOL_ROTATION = ("EA0S", "EB0S", "EC0S")


@cache
def volume(machine):
    """256 points spread evenly over the travel, default tools in turn."""
    exact = MACHINES[machine]
    low, high = np.array([exact.travel[a] for a in exact.axes], float).T
    q = low + qmc.Sobol(3, seed=3).random(256) * (high - low)
    return q, default_tools()[np.arange(256) % 3]
