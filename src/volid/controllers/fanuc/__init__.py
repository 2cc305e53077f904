"""Fanuc: the memory of pitch errors, and the vectors of three-dimensional error compensation."""
