"""Model-free multilateration: adjustment of distance networks, free or with fixed points, in the plane or in space."""

from volid.multilateration.adjustment import adjust_network
from volid.multilateration.network_solution import Alternative, NetworkSolution, Offset
from volid.multilateration.start import starting_coordinates
from volid.multilateration.trials import NetworkTrials, network_trials

__all__ = [
    "Alternative",
    "NetworkSolution",
    "NetworkTrials",
    "Offset",
    "adjust_network",
    "network_trials",
    "starting_coordinates",
]
