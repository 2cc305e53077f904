"""Circular tests with a double ball bar by ISO 230-4, and the geometry behind them."""
