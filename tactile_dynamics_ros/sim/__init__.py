"""The PyBullet stand-in for the hardware; the only part of the package that imports pybullet."""
