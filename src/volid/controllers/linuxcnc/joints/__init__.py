"""Joints of LinuxCNC: their numbers, their tables of one axis each, the files and INI lines that hold these."""
