"""Solutions of one machine compared: what changed, and how it drifts."""
