"""Arrays of floats, as annotations name them."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Floats of any shape; the shape, frame and unit stand where one is taken or returned."""
