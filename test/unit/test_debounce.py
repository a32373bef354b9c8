"""Switches that ignore short interruptions."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.tactile.slip import Debounced


def test_a_switch_flips_at_the_last_of_its_frames_in_a_row():
    switch = Debounced(3)
    wanted = [1, 1, 0, 1, 1, 1, 0, 0, 1, 0, 0, 0, 1]
    assert [bool(switch.update(bool(each))) for each in wanted] == [
        *[False] * 5,
        *[True] * 6,
        *[False] * 2,
    ]


def test_switches_of_an_array_are_their_own():
    switches = Debounced([1, 2, 3])
    wanted = np.array([[True, True, True], [True, True, False], [False, True, True]])
    found = np.array([switches.update(row) for row in wanted])
    assert found.tolist() == [[True, False, False], [True, True, False], [False, True, False]]
    assert switches.streak.tolist() == [0, 0, 1]
    switches.reset()
    assert not switches.on.any() and not switches.streak.any()
