"""HEIDENHAIN: tables of axis errors, and the error lines of a kinematics table."""
