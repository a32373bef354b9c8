"""The live comparison answers as the commands do on a recording of the same measurements."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_recording import held_box

from tactile_dynamics_ros.core.inertia.diagnosis.live_check import LiveModelCheck
from tactile_dynamics_ros.core.streams.streams import ContactSample, Streams


@pytest.fixture(scope="module")
def streams():
    return held_box(seconds=12.0).streams


def fed_with(streams: Streams) -> LiveModelCheck:
    """A check that has got all measurements, in the order of their stamps."""
    check, pose = LiveModelCheck(), streams.pose
    for k, time in enumerate(pose.time):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation[k], pose.position[k]
        check.window.add_pose(time, matrix, None if pose.covariance is None else pose.covariance[k])
    for name, contact in streams.contacts.items():
        for k, time in enumerate(contact.time):
            std = None if contact.force_std is None else contact.force_std[k]
            place = np.searchsorted(contact.pose_time, time).clip(0, len(contact.pose_time) - 1)
            where = contact.position[place], contact.rotation[place]
            check.window.add_contact(
                ContactSample(time, name, *where, contact.force[k], contact.torque[k], std)
            )
    return check


def test_clean_measurements_are_adequate(streams):
    check = fed_with(streams)
    assert check.compare().whitened_rms == pytest.approx(1.0, abs=0.1)
    assert check.diagnose()["verdict"] == "adequate"


def test_noise_that_is_twice_what_is_stated_is_no_missing_effect(streams):
    contacts = {
        name: replace(contact, force_std=0.5 * contact.force_std)
        for name, contact in streams.contacts.items()
    }
    found = fed_with(replace(streams, contacts=contacts)).diagnose()
    assert found["verdict"] == "adequate"
    assert found["error"]["before"] == pytest.approx(1.0, abs=0.1)
