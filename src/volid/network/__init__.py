"""Model-free multilateration: adjustment of distance networks, free or with fixed points, in the plane or in space."""

from volid.network.adjustment import NetworkSolution, adjust_network
from volid.network.start import starting_coordinates

__all__ = ["NetworkSolution", "adjust_network", "starting_coordinates"]
