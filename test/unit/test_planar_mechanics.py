"""Mechanics of pushed objects against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.mechanics.limit_surface import pushed_twist, sticking_twist
from tactile_dynamics_ros.core.planar.mechanics.linkage import Joint, Link, Linkage
from tactile_dynamics_ros.core.planar.mechanics.pusher import Grip, Tip
from tactile_dynamics_ros.core.planar.mechanics.simulation import (
    GRAVITY,
    StepConfig,
    simulate,
)
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch, tipping_shift

SIDE = 0.1
SQUARE = 0.5 * SIDE * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
TURN = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
DISC = 0.05 * np.stack([np.cos(TURN), np.sin(TURN)], axis=1)
AWAY = np.array([9.0, 9.0, 0.0])


def make_link(friction, mass=1.0, com=(0.0, 0.0), height=0.0, count=100):
    friction = np.atleast_1d(np.asarray(friction, dtype=float))
    even = np.ones(len(friction))
    return Link(
        SupportPatch(SQUARE, count),
        mass * even,
        friction,
        np.tile(com, (len(friction), 1)).astype(float),
        height * even,
        mass * SIDE**2 / 6.0 * even,
        even,
    )


def stay_away(batch, steps):
    return np.broadcast_to(AWAY, (batch, steps, 3))


def straight(start, speed, steps, step):
    path = np.zeros((1, steps, 3))
    path[0, :, 0] = start[0] + speed * step * np.arange(steps)
    path[0, :, 1] = start[1]
    return path


@pytest.mark.parametrize(("outline", "radius"), [(DISC, 0.05 * 2 / 3), (SQUARE, 0.3826 * SIDE)])
def test_friction_radius_of_an_even_face(outline, radius):
    found = SupportPatch(outline, 400).friction_radius(np.zeros((1, 2)), np.ones(1))
    assert_allclose(found, radius, rtol=3e-3)


@pytest.mark.parametrize("reach", [0.01, 0.03])
def test_pressure_has_the_centre_that_balances_and_never_pulls(reach):
    """0.03 m is outside the kern of the square (a sixth of its side), so that a part lifts."""
    patch = SupportPatch(SQUARE, 400)
    pressure = patch.pressure(np.array([[reach, 0.0]]), np.ones(1))[0]
    assert pressure.min() >= 0.0
    assert_allclose(pressure.sum(), 1.0)
    assert_allclose(pressure @ patch.offset, [reach, 0.0], atol=1e-6)
    assert np.any(pressure == 0.0) == (reach > SIDE / 6.0)


def test_an_uneven_face_keeps_load_and_centre_of_pressure():
    patch = SupportPatch(SQUARE)
    pressure = patch.pressure(np.array([[0.0, 0.0], [0.01, -0.02]]), np.ones(2))
    draws = np.random.default_rng(0).normal(size=(50, len(patch.share)))
    for draw, change in zip(draws, patch.balanced(pressure, draws), strict=True):
        assert np.abs(np.sum(pressure * change, axis=1)).max() < 1e-7
        assert np.abs((pressure * change) @ patch.offset).max() < 1e-7
        assert np.std(change - draw) < 0.5


@pytest.mark.parametrize("reach", [0.01, 0.03])
def test_slope_of_the_pressure_is_its_derivative_while_the_same_points_carry(reach):
    patch = SupportPatch(SQUARE, 400)
    centre, scale = np.array([[reach, 0.004]]), np.array([1.1])
    pressure, slope = patch.pressure_and_slope(centre, scale)
    assert_allclose(pressure, patch.pressure(centre, scale))
    for axis, step in enumerate(1e-7 * np.eye(2)):
        ahead, behind = (patch.pressure(centre + k * step, scale) for k in (1, -1))
        assert_allclose(slope[:, :, axis], (ahead - behind) / 2e-7, atol=1e-4)


def test_a_slow_push_tips_forward_by_height_times_force_over_weight():
    push = np.array([[2.0, 0.0]])
    shift = tipping_shift(np.array([9.81]), np.array([0.05]), -push, push, np.array([0.02]))
    assert_allclose(shift, [[0.02 * 2.0 / 9.81, 0.0]])


def test_an_object_slides_on_for_speed_squared_over_two_mu_g():
    friction, speed = np.array([0.2, 0.5]), 0.5
    link = make_link(friction)
    twist = np.zeros((2, 1, 3))
    twist[:, 0, 0] = speed
    tip = Tip(SQUARE, np.zeros(2), np.full(2, 0.3))
    motion = simulate(
        Linkage((link,)), tip, np.zeros((2, 1, 3)), stay_away(2, 400), StepConfig(1e-3), twist
    )
    expected = speed**2 / (2.0 * friction * GRAVITY)
    assert_allclose(motion.pose[:, -1, 0, 0], expected, rtol=0.01)
    energy = np.sum(motion.twist[:, :, 0] ** 2 * [1.0, 1.0, SIDE**2 / 6.0], axis=2)
    assert np.all(np.diff(energy, axis=1) <= 1e-15)


def push(config, start=(-0.0501, 0.02), speed=0.02, distance=0.03, height=0.0):
    link = make_link(0.3, height=height)
    tip = Tip(SQUARE, np.full(1, height), np.full(1, 0.4))
    steps = round(distance / speed / config.step) + 1
    path = straight(start, speed, steps, config.step)
    return simulate(Linkage((link,)), tip, np.zeros((1, 1, 3)), path, config)


def test_a_slow_central_push_takes_the_friction_force():
    motion = push(StepConfig(5e-3), start=(-0.0501, 0.0))
    assert_allclose(motion.wrench[0, -1], [0.3 * GRAVITY, 0.0, 0.0], atol=2e-3)


def test_slow_pushes_are_quasi_static():
    slow = push(StepConfig(5e-3)).pose[0, -1, 0]
    without_inertia = push(StepConfig(5e-3, quasi_static=True)).pose[0, -1, 0]
    assert np.all(np.abs(slow - without_inertia) < [5e-5, 5e-5, 1e-3])
    assert abs(slow[2]) > 0.1


@pytest.mark.parametrize(("speed", "most", "share"), [(0.02, 2e-5, 0.2), (0.1, 1.5e-4, 0.6)])
def test_steps_converge(speed, most, share):
    """Pushes of 15 mm; at 100 mm/s the impact is what steps of 5 ms blur."""
    fine, middle, coarse = (
        push(StepConfig(step), speed=speed, height=0.02, distance=0.015).pose[0, -1, 0, :2]
        for step in (0.5e-3, 1e-3, 5e-3)
    )
    assert np.linalg.norm(coarse - fine) < most
    assert np.linalg.norm(middle - fine) < share * np.linalg.norm(coarse - fine)


def test_below_the_friction_force_nothing_creeps():
    """The grip's spring pulls with 1.5 N for a second; friction holds 2.9 N."""
    grip = Grip(np.zeros((1, 2)), np.zeros(1), np.zeros(1), stiffness=1500.0)
    path = np.broadcast_to([1e-3, 0.0, 0.0], (1, 201, 3))
    motion = simulate(Linkage((make_link(0.3),)), grip, np.zeros((1, 1, 3)), path)
    assert abs(motion.pose[0, -1, 0, 0]) < 5e-6
    assert_allclose(motion.wrench[0, -1, 0], 1.5, rtol=0.01)


def pair(rigid, friction=0.0, support=0.0):
    joint = Joint(
        np.array([[0.05, 0.0]]), np.array([[-0.05, 0.0]]), np.full(1, friction), rigid=rigid
    )
    return Linkage((make_link(support), make_link(support, mass=0.5)), joint)


def test_a_free_pair_keeps_its_momentum():
    linkage = pair(rigid=False)
    pose = np.array([[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]])
    twist = np.array([[[0.1, 0.2, 0.0], [0.1, 0.2, 0.0]]])
    twist[0, 1] += [0.0, 0.05 * 3.0, 3.0]
    tip = Tip(SQUARE, np.zeros(1), np.full(1, 0.3))
    motion = simulate(linkage, tip, pose, stay_away(1, 400), StepConfig(1e-3), twist)
    momentum = motion.twist[0, :, 0, :2] + 0.5 * motion.twist[0, :, 1, :2]
    assert_allclose(momentum[-1], momentum[0], atol=1e-9)
    assert np.ptp(motion.pose[0, :, 1, 2] - motion.pose[0, :, 0, 2]) > 0.5


@pytest.mark.parametrize("rigid", [True, False])
def test_links_stay_together(rigid):
    linkage = pair(rigid, friction=0.02, support=0.3)
    pose = np.array([[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]])
    tip = Tip(SQUARE, np.zeros(1), np.full(1, 0.3))
    path = straight((-0.0501, 0.03), 0.05, 201, 5e-3)
    last = simulate(linkage, tip, pose, path).pose[0, -1]
    assert abs(last[0, 2]) > 0.1
    cos, sin = np.cos(last[:, 2]), np.sin(last[:, 2])
    ends = last[:, :2] + np.array([0.05, -0.05])[:, None] * np.stack([cos, sin], axis=1)
    assert_allclose(ends[0], ends[1], atol=1e-12)
    assert (abs(last[1, 2] - last[0, 2]) < 1e-12) == rigid


def test_sticking_by_the_ellipsoid_moves_the_contact_with_the_pusher():
    rng = np.random.default_rng(3)
    contact, velocity = rng.normal(size=(2, 20, 2))
    radius = rng.uniform(0.5, 2.0, 20)
    twist = sticking_twist(contact, velocity, radius)
    at_contact = twist[:, :2] + twist[:, 2:] * np.stack([-contact[:, 1], contact[:, 0]], axis=1)
    assert_allclose(at_contact, velocity, atol=1e-12)
    normal = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    rough = pushed_twist(contact, normal, velocity, radius, np.full(20, 1e3))
    assert_allclose(rough, twist)
    smooth = pushed_twist(contact, normal, velocity, radius, np.zeros(20))
    torque = contact[:, 0] * normal[:, 1] - contact[:, 1] * normal[:, 0]
    assert_allclose(smooth[:, 2] * radius**2, torque * np.linalg.norm(smooth[:, :2], axis=1))


def test_a_footprint_without_area_is_refused():
    with pytest.raises(BadInputError, match="vertices enclose"):
        SupportPatch(np.zeros((4, 2))).share  # noqa: B018
