"""Growing and shrinking of sets of pixels against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from tactile_dynamics_ros.core.tracking.depth_image import grow, grow_cross, shrink

SQUARE = np.ones((3, 3), dtype=bool)


@pytest.mark.parametrize("reach", [1, 3, 10])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.97])
def test_squares_grow_and_shrink_as_those_of_scipy(reach, share):
    mask = np.random.default_rng(reach).random((37, 52)) < share
    grown = ndimage.binary_dilation(mask, SQUARE, iterations=reach)
    shrunk = ndimage.binary_erosion(mask, SQUARE, iterations=reach)
    assert np.array_equal(grow(mask, reach), grown)
    assert np.array_equal(shrink(mask, reach), shrunk)
    assert np.array_equal(shrink(grow(mask)), ndimage.binary_closing(mask, SQUARE))
    assert np.array_equal(grow_cross(mask), ndimage.binary_dilation(mask))


def test_a_reach_beyond_the_image_is_the_whole_image():
    mask = np.zeros((4, 6), dtype=bool)
    mask[3, 0] = True
    assert grow(mask, 20).all() and not grow(mask, 4).all()
    assert not shrink(np.ones((4, 6), dtype=bool), 20).any()
