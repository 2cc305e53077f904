"""LinuxCNC: screw compensation of joints, kinematics of nine numbers, spatial grids in HAL."""
