"""Evaluations by a standard alone: what ISO 230-2, 230-4 and 230-6 make of readings, without an error model."""
