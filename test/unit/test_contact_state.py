"""Contacts in the world: place on the skin, normal, force and its uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.contact.contact_state import ContactState, ContactStateConfig
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics, JointUncertaintyConfig
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.shape.skin_surface import (
    point_from_wrench,
    project_to_skin,
    skin_normal,
)

ROBOT = load_robot()

POSITIONS = np.concatenate([[0.1, 0.5, -0.2, -1.2, 0.3, 0.7, 0.0], np.full(16, 0.4)])
STD = np.full(3, 0.03)


def skin_points() -> np.ndarray:
    rng = np.random.default_rng(0)
    angle, along = rng.uniform(-1.2, 1.2, 40), rng.uniform(-0.015, 0.006, 40)
    radius = np.sqrt(ROBOT.tips.radius**2 - np.maximum(along, 0.0) ** 2)
    return np.stack([along, radius * np.sin(angle), -radius * np.cos(angle)], axis=-1)


def test_projection_keeps_points_of_the_skin_and_normals_point_outward():
    points = skin_points()
    assert_allclose(project_to_skin(1.2 * points)[points[:, 0] > 0], points[points[:, 0] > 0])
    assert_allclose(project_to_skin(points), points, atol=1e-12)
    assert_allclose(np.linalg.norm(skin_normal(points), axis=-1), 1.0)
    assert np.all(np.sum(skin_normal(points) * points, axis=-1) > 0.0)


def test_wrench_about_the_origin_tells_the_contact_point():
    rng = np.random.default_rng(1)
    for point in skin_points():
        normal = skin_normal(point)
        tangent = np.cross(normal, rng.normal(size=3))
        force = 1.3 * normal + 0.4 * tangent / np.linalg.norm(tangent)
        found = point_from_wrench(force, np.cross(point, force))
        assert_allclose(found, point, atol=1e-9)


def test_force_and_normal_point_into_the_object():
    state = ContactState(HandKinematics())
    force = np.array([0.1, 0.2, -1.0])
    point = np.array([-0.004, 0.0, -ROBOT.tips.radius])
    contact = state.update("middle", POSITIONS, force, STD, np.cross(point, force))
    pose = state.kinematics.sensor_pose("middle", POSITIONS)
    assert_allclose(contact.force, pose[:3, :3] @ force)
    assert_allclose(contact.point, pose[:3, :3] @ point + pose[:3, 3], atol=1e-9)
    assert_allclose(contact.rotation[:, 2], -pose[:3, 2], atol=1e-9)
    assert contact.rotation[:, 2] @ contact.force > 0.9
    assert_allclose(contact.rotation @ contact.rotation.T, np.eye(3), atol=1e-12)
    assert contact.touching
    assert not state.update("middle", POSITIONS, np.zeros(3), STD).touching


def test_std_contains_the_error_of_the_sensor_orientation():
    joints = JointUncertaintyConfig(hand_offset=0.02, arm_offset=0.0)
    config = ContactStateConfig(joints=joints, mount_std_deg=1.0)
    state = ContactState(HandKinematics(), config)
    force, rng = np.array([0.3, 0.0, -2.0]), np.random.default_rng(2)
    contact = state.update("index", POSITIONS, force, STD)
    variance = joints.constant_variance(ROBOT) + joints.varying_variance(ROBOT)
    errors = []
    for _ in range(3000):
        positions = POSITIONS + np.sqrt(variance) * rng.normal(size=ROBOT.dof)
        rotation = state.kinematics.sensor_pose("index", positions)[:3, :3]
        mount = exp_so3(np.deg2rad(1.0) * rng.normal(size=3))
        errors.append(mount @ rotation @ (force + STD * rng.normal(size=3)) - contact.force)
    assert_allclose(contact.force_std, np.std(errors, axis=0), rtol=0.06)
    assert np.all(contact.force_std[:2] > 1.2 * STD[:2])


def test_bad_force_is_refused():
    state = ContactState(HandKinematics())
    with pytest.raises(BadInputError, match="force"):
        state.update("index", POSITIONS, np.array([np.nan, 0.0, 0.0]), STD)
