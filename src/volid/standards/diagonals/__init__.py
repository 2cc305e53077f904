"""Displacements along body and face diagonals by ISO 230-6."""
