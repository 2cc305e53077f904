"""Model-free multilateration: adjustment of distance networks, free or with fixed points, in the plane or in space."""

from volid.multilateration.adjustment import NetworkSolution, adjust_network
from volid.multilateration.start import starting_coordinates
from volid.multilateration.trials import NetworkTrials, network_trials

__all__ = ["NetworkSolution", "NetworkTrials", "adjust_network", "network_trials", "starting_coordinates"]
