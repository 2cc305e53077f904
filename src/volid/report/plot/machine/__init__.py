"""The machine drawn from its structural code: a scheme of its bodies and axes, and the chain as a row of boxes."""
