"""Accuracy and repeatability of positioning by ISO 230-2, linear and rotary axes."""
