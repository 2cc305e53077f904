"""What may be wrong when the residuals do not fit, each cause as further unknowns tested around the solution."""
