"""Evaluations by a standard, in words and as the figures that people know from their reports."""
