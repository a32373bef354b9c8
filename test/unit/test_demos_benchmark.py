"""Whole demos: how far the estimate they end with is from the truth."""

import numpy as np
import pytest

from benchmarks.demos import deviation


def document(**changed):
    inertia = np.diag([1.0, 2.0, 3.0])
    found = {
        "mass": {"value": 0.4, "std": 0.01},
        "com": {"value": [0.0, 0.0, 0.0], "std": [0.01, 0.01, 0.01]},
        "inertia_com": {"value": inertia.tolist(), "std": np.full((3, 3), 0.1).tolist()},
    }
    return found | changed


TRUTH = {"mass": 0.4, "com": [0.0, 0.0, 0.02], "inertia_com": np.diag([1.0, 2.0, 3.7]).tolist()}


def test_the_farthest_of_ten_numbers_counts():
    assert deviation(document(), TRUTH) == pytest.approx(7.0)


def test_what_the_motion_does_not_determine_is_left_out():
    assert deviation(document(undetermined=["inertia_zz"]), TRUTH) == pytest.approx(2.0)
