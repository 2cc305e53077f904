"""A solution tested by readings that its fit has not seen."""
