"""Solutions under test: by readings that the fit has not seen, and by other solutions of the same machine."""
