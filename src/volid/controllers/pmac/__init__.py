"""(Turbo) PMAC: tables over the counts of motors."""
