"""Sequential step diagonals: nine displacement functions, and what leaks into them."""
