"""Shapes as messages: what is told comes back, in the frames of the links; nonsense is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rclpy.serialization import deserialize_message, serialize_message

from tactile_dynamics_ros.core.shape.superquadric.recovery import recover
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric
from tactile_dynamics_ros.core.shape.superquadric.words import describe
from tactile_dynamics_ros.ros.conversions import MessageError
from tactile_dynamics_ros.ros.shape_messages import STDS, shape_from_message, shape_message

SIZES = (np.array([0.05, 0.03, 0.04]), np.array([0.02, 0.04, 0.03]))


@pytest.fixture(scope="module")
def parts():
    """Two recovered parts: an upright box, turned by 0.5 rad, and an ellipse beside it."""
    found = []
    for axes, section, turn, x in zip(SIZES, (0.2, 1.0), (0.5, -0.3), (0.5, 0.6), strict=True):
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        pose[:3, 3] = [x, -0.1, axes[2]]
        shape = Superquadric(axes, np.array([0.2, section]), pose=pose)
        points = shape.sample(600, seed=1)[0]
        noise = np.random.default_rng(2).normal(scale=[1e-4, 2e-4, 3e-4], size=points.shape)
        found.append(recover(points + noise, 0.0))
    return found


@pytest.fixture
def message(parts):
    """Their message, as it comes over the wire."""
    sent = shape_message(parts, 12.25)
    return deserialize_message(serialize_message(sent), type(sent))


def test_parts_come_back_as_they_were(parts, message):
    assert message.header.frame_id == "world"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 250_000_000)
    links = shape_from_message(message)
    assert [link.name for link in links] == ["link_1", "link_2"]
    for part, link in zip(parts, links, strict=True):
        for name in ("semi_axes", "exponents", "taper", "pose"):
            assert_allclose(getattr(link.shape, name), getattr(part.shape, name), atol=1e-8)
        assert link.words == describe(part)
        known = {name for names in STDS.values() for name in names}
        assert set(link.std) == known == set(part.std) | {"z"}
        for name, value in part.std.items():
            assert link.std[name] == pytest.approx(value, rel=1e-8)
        assert link.std["z"] == pytest.approx(part.std["az"])


def test_a_footprint_is_told_in_the_frame_of_its_link(message):
    for axes, status, link in zip(SIZES, message.status, shape_from_message(message), strict=True):
        told = {pair.key: pair.value for pair in status.values}["footprint_m"]
        outline = np.array([float(word) for word in told.split()]).reshape(-1, 2)
        assert_allclose(outline, link.footprint, atol=1e-8)
        half = np.sort(0.5 * np.ptp(outline, axis=0))
        assert_allclose(half, np.sort(axes[:2]), atol=1e-3)
        assert_allclose(outline.max(axis=0), -outline.min(axis=0), atol=1e-4)


@pytest.mark.parametrize(
    ("key", "text", "kind"),
    [
        ("semi_axes_m", "0.1 0.2", "bad_shape"),
        ("semi_axes_m", "0.1 0.2 -0.3", "bad_shape"),
        ("semi_axes_m", "0.1 0.2 nan", "bad_shape"),
        ("exponents", "wide", "bad_shape"),
        ("quaternion", "0 0 0 0.5", "bad_quaternion"),
        ("yaw_rad_std", None, "bad_shape"),
    ],
)
def test_nonsense_is_refused_by_its_key(message, key, text, kind):
    status = message.status[1]
    others = [pair for pair in status.values if pair.key != key]
    pair = next(pair for pair in status.values if pair.key == key)
    if text is not None:
        pair.value = text
        others.append(pair)
    status.values = others
    with pytest.raises(MessageError, match="object/shape: link_2") as error:
        shape_from_message(message)
    assert error.value.kind == kind


def test_another_frame_is_refused(message):
    message.header.frame_id = "camera"
    with pytest.raises(MessageError, match="frame_id 'camera'"):
        shape_from_message(message)
