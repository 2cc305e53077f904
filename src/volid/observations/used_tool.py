"""The tool vector that a campaign used most: outputs refer to it where none is named."""

from __future__ import annotations

import numpy as np

from volid.campaign import SAME_TOOL, Campaign
from volid.observations import KINDS


def most_used_tool(campaign: Campaign) -> tuple[float, float, float]:
    """The tool vector of most rows that see the tool, as their kinds state it [mm]; of equally frequent ones the first.

    Where no set sees the tool, all rows count.
    """
    seen = [s.all_ends.tool for s in campaign.sets if KINDS[s.kind].sees_tool(s)]
    tools = np.round(np.concatenate(seen or [s.all_ends.tool for s in campaign.sets]), SAME_TOOL)
    values, first, counts = np.unique(tools, axis=0, return_index=True, return_counts=True)
    x, y, z = (values[np.lexsort((first, -counts))[0]] + 0.0).tolist()
    return x, y, z
