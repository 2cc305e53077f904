"""Uncertainty: propagation, Monte Carlo refits, coverage intervals and budgets."""
