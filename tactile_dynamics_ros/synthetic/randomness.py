"""Independent random streams that are named, so that changing one draw never shifts another."""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, *purpose: str) -> np.random.Generator:
    """Return the generator that belongs to a seed and a purpose."""
    return np.random.default_rng([seed, *(zlib.crc32(word.encode()) for word in purpose)])


def unit_vector(rng: np.random.Generator) -> np.ndarray:
    """Draw a direction uniformly from the sphere."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)
