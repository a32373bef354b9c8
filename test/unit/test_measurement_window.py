"""The window of live measurements keeps the last seconds in which the object was held."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.streams.measurement_window import MeasurementWindow
from tactile_dynamics_ros.core.streams.streams import ContactSample

FORCE = np.array([0.0, 0.0, 2.0])
KEPT = 10.0


def touch(window, time, force):
    window.add_contact(ContactSample(time, "index", np.zeros(3), np.eye(3), force))


def after_a_grasp(poses, forces, seconds=100.0):
    """A window after 6 s of a grasp, and what came at 10 Hz for some seconds without a touch."""
    window = MeasurementWindow(KEPT)
    for time in np.arange(0.0, 6.05, 0.1):
        window.add_pose(time, np.eye(4), None)
        touch(window, time, FORCE)
    for time in np.arange(6.1, 6.1 + seconds, 0.1):
        if poses:
            window.add_pose(time, np.eye(4), None)
        if forces:
            touch(window, time, np.zeros(3))
    return window


@pytest.mark.parametrize(("poses", "forces"), [(False, True), (True, False), (True, True)])
def test_what_comes_while_nothing_is_held_does_not_push_the_grasp_out(poses, forces):
    window = after_a_grasp(poses, forces)
    streams = window.streams(KEPT)
    index = streams.contacts["index"]
    assert np.count_nonzero(index.force[:, 2]) == 61
    assert np.count_nonzero(streams.pose.time < 6.05) == 61
    assert window.newest == pytest.approx(6.0)
    assert window.span == pytest.approx(6.0)
    most = 61 + 50 + 1
    assert len(index.time) <= most
    assert len(streams.pose.time) <= most


def test_poses_that_come_before_the_forces_of_the_same_seconds_are_kept():
    window = after_a_grasp(True, True)
    for batch in (200.0, 203.0):
        times = batch + 0.1 * np.arange(30)
        for time in times:
            window.add_pose(time, np.eye(4), None)
        for time in times:
            touch(window, time, FORCE)
    streams = window.streams()
    grasp = streams.pose.time > 199.9
    assert np.count_nonzero(grasp) == 60
    assert np.count_nonzero(streams.contacts["index"].force[:, 2]) == 60


def test_what_is_kept_while_nothing_is_held_is_bounded():
    window = MeasurementWindow(KEPT)
    for time in 0.1 * np.arange(600):
        window.add_pose(time, np.eye(4), None)
        touch(window, time, np.zeros(3))
    entries = window._poses, window._contacts["index"]
    assert max(len(each.kept) + len(each.coming) for each in entries) <= 51
    with pytest.raises(BadInputError, match="nothing held yet"):
        window.streams()


def test_the_next_grasp_replaces_the_last_as_time_goes_on():
    window = after_a_grasp(True, True)
    for time in np.arange(120.0, 132.0, 0.1):
        window.add_pose(time, np.eye(4), None)
        touch(window, time, FORCE)
    streams = window.streams()
    assert streams.pose.time[0] == pytest.approx(131.9 - KEPT, abs=1e-6)
    assert streams.contacts["index"].force[:, 2].all()
