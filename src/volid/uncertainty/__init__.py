"""How sure: propagation, Monte Carlo refits, coverage intervals, budgets, studies of many campaigns."""
