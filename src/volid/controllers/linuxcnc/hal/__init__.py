"""Grids of corrections in LinuxCNC's HAL: the text of their files, what the values mean, and how the component is wired."""
