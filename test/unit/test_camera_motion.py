"""Whether a moving camera rests where it was sent, and what is said where it does not."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, matrix_to_quaternion
from tactile_dynamics_ros.core.shape.superquadric.views import looking_at
from tactile_dynamics_ros.ros.camera_motion import NEAR, TURNED, CameraMotion, is_near
from tactile_dynamics_ros.ros.names import CAMERA_POSE
from tactile_dynamics_ros.ros.wire import Stamp, Stamped

TARGET = looking_at(np.array([0.5, 0.4, 0.4]), np.zeros(3))


class Ears:
    """Stands in for a node: keeps who listens to what."""

    def __init__(self):
        self.hears = {}

    def listen(self, _, topic, callback):
        self.hears[topic] = callback


@pytest.fixture
def heard():
    node = Ears()
    camera = CameraMotion(node)

    def tell(time, pose):
        values = np.concatenate([pose[:3, 3], matrix_to_quaternion(pose[:3, :3])])
        node.hears[CAMERA_POSE](Stamped(stamp(time), "world", values))

    return camera, tell


def stamp(time):
    return Stamp(int(time), round(1e9 * (time % 1.0)))


def shifted(metres):
    pose = TARGET.copy()
    pose[0, 3] += metres
    return pose


def rests(camera, tell, path, when):
    """Whether it rests at a time, having been at path(t) every 20 ms since t = 1."""
    for time in np.arange(1.0, when + 0.05, 0.02):
        tell(time, path(time))
    return camera.rested_at(TARGET, stamp(when))


def test_it_rests_where_it_has_stood_for_a_while_near_its_target(heard):
    found = rests(*heard, lambda _: shifted(0.5 * NEAR), 1.5)
    np.testing.assert_allclose(found, shifted(0.5 * NEAR), atol=1e-9)


@pytest.mark.parametrize(
    ("path", "when"),
    [
        (lambda _: shifted(1.5 * NEAR), 1.5),
        (lambda time: shifted(0.02 * (time - 1.5)), 1.5),
        (lambda time: shifted(min(0.0, 0.2 * (time - 1.45))), 1.5),
        (lambda _: TARGET, 1.05),
    ],
    ids=["elsewhere", "passing by", "just arrived", "not long known"],
)
def test_it_does_not_rest(heard, path, when):
    assert rests(*heard, path, when) is None


def test_a_clock_that_jumps_back_begins_anew(heard):
    camera, tell = heard
    assert rests(camera, tell, lambda _: TARGET, 1.5) is not None
    tell(0.5, TARGET)
    assert camera.rested_at(TARGET, stamp(1.5)) is None


def test_only_a_move_begins_the_waiting_anew(heard):
    camera, tell = heard
    tell(1.0, TARGET)
    before = camera.moved
    tell(1.1, TARGET)
    assert camera.moved == before
    tell(1.2, shifted(0.01))
    assert camera.moved > before


def test_what_is_missing_is_said(heard):
    camera, tell = heard
    with pytest.raises(NotIdentifiableError, match="camera/pose yet"):
        camera.still_at()
    tell(1.0, shifted(0.1))
    assert "camera_info" in camera.complaint(TARGET)
    camera.intrinsics = np.eye(3)
    assert "100 mm from" in camera.complaint(TARGET)
    tell(1.1, TARGET)
    assert "whose stamp fits" in camera.complaint(TARGET)


def test_near_is_both_place_and_turn():
    turned = TARGET.copy()
    turned[:3, :3] = turned[:3, :3] @ exp_so3(np.array([0.0, 0.0, 1.2 * TURNED]))
    assert is_near(TARGET, shifted(0.9 * NEAR), NEAR, TURNED)
    assert not is_near(TARGET, shifted(1.1 * NEAR), NEAR, TURNED)
    assert not is_near(TARGET, turned, NEAR, TURNED)
