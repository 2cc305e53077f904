"""SINUMERIK: initialisation files of system variables."""
