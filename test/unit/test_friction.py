"""Friction probing: cone, surface, slip detection, onset, estimate, fingertip force, hold."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.friction.estimate import (
    FrictionEstimateConfig,
    SlipEvent,
    estimate_friction,
    estimate_region,
)
from tactile_dynamics_ros.core.friction.hold import (
    FingertipImpedance,
    ImpedanceConfig,
    balance_forces,
    total_wrench,
)
from tactile_dynamics_ros.core.friction.probe import FrictionProbe
from tactile_dynamics_ros.core.friction.probe_config import (
    FrictionProbeConfig,
    ProbeContact,
    ProbeInput,
    ProbePhase,
    friction_coefficient,
    probing_angles,
    split_force,
    tangent_basis,
)
from tactile_dynamics_ros.core.friction.slip_detection import SlipFusion, SlipObservation
from tactile_dynamics_ros.core.friction.slip_log import find_slip
from tactile_dynamics_ros.core.rigid_body.rotation import align_points, exp_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.shape.friction_regions import ObjectSurface

ROBOT = load_robot()

UP = np.array([0.0, 0.0, 1.0])
BOX = {
    "shapes": [{"box": [0.2, 0.1, 0.06], "centre": [0.0, 0.0, 0.03]}],
    "regions": [{"name": "label", "lower": [-0.2, -0.2, 0.02], "upper": [0.2, 0.2, 0.04]}],
}


def test_coefficient_is_the_slope_of_the_force():
    for mu in (0.1, 0.5, 1.2):
        force = 1.7 * (UP + mu * np.array([0.6, 0.8, 0.0]))
        assert friction_coefficient(force, 3.0 * UP) == pytest.approx(mu)
        normal, tangential = split_force(force, UP)
        assert tangential / normal == pytest.approx(mu)


def test_a_force_that_pulls_has_no_coefficient():
    with pytest.raises(BadInputError, match="does not press"):
        friction_coefficient(-UP, UP)


def test_directions_come_in_opposite_pairs():
    angles = probing_angles(8)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    np.testing.assert_allclose(directions[0::2], -directions[1::2], atol=1e-12)
    np.testing.assert_allclose(np.diff(np.sort(angles)), np.pi / 4)


def test_basis_spans_the_plane_of_contact():
    for along in (UP, np.array([0.3, 0.5, -0.2])):
        basis = tangent_basis(UP, along)
        np.testing.assert_allclose(np.cross(*basis), UP, atol=1e-12)


def test_points_are_aligned_by_their_motion():
    points = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.01], [0.0, 0.06, 0.0]])
    turn, shift = exp_so3(np.array([0.1, -0.3, 0.2])), np.array([0.01, 0.02, 0.03])
    found, moved = align_points((points - shift) @ turn, points)
    np.testing.assert_allclose(found, turn, atol=1e-9)
    np.testing.assert_allclose(moved, shift, atol=1e-9)


def test_nearest_triangle_gives_normal_distance_and_region():
    surface = ObjectSurface.from_mapping(BOX)
    place = surface.locate(np.array([0.03, 0.052, 0.03]))
    np.testing.assert_allclose(place.normal, [0, -1, 0], atol=1e-9)
    assert place.distance == pytest.approx(2e-3)
    assert place.region == "label"
    assert surface.locate(np.array([0.0, -0.05, 0.005])).region == "body"


def test_a_ball_has_a_surface():
    ball = {"sphere": {"radius": 0.03}, "centre": [0.01, 0.0, 0.0]}
    place = ObjectSurface.from_mapping({"shapes": [ball]}).locate(np.array([0.045, 0.0, 0.0]))
    assert place.distance == pytest.approx(0.005, abs=2e-4)
    np.testing.assert_allclose(place.normal, [-1, 0, 0], atol=0.06)


def test_an_object_without_shapes_is_refused():
    with pytest.raises(BadInputError, match="shapes"):
        ObjectSurface.from_mapping({"name": "x"})


def slip_signals(rng, onset=1.0, end=1.4, speed=0.006):
    """Vibration, electrode change and path at 100 Hz with a slip from ``onset``."""
    time = np.arange(0.0, end, 0.01)
    sliding = time >= onset
    vibration = np.exp(rng.normal(0.0, 0.2, len(time)) + 0.9 * sliding)
    electrodes = rng.normal(0.0, 0.3, len(time)) + 1.5 * sliding
    path = np.maximum(time - onset, 0.0) * speed + rng.normal(0.0, 3e-5, len(time))
    return time, vibration, electrodes, path


def test_slip_is_told_soon_and_dated_back_to_its_onset():
    rng = np.random.default_rng(0)
    delays, errors = [], []
    for _ in range(20):
        fusion = SlipFusion()
        for time, vibration, electrodes, path in zip(*slip_signals(rng), strict=True):
            state = fusion.update(time, SlipObservation(vibration, electrodes, path))
            assert not state.slipping or time >= 1.0
            if state.slipping:
                delays.append(time - 1.0)
                errors.append(state.onset - 1.0)
                break
    assert len(delays) == 20
    assert np.median(delays) <= 0.05
    assert np.abs(np.median(errors)) <= 0.02


def test_rest_is_not_told_as_slip():
    rng = np.random.default_rng(1)
    fusion = SlipFusion()
    signals = slip_signals(rng, onset=1e9, end=60.0)
    alarms = [
        fusion.update(t, SlipObservation(v, e, p)).slipping
        for t, v, e, p in zip(*signals, strict=True)
    ]
    assert not any(alarms)


def slow_slip(rng, expected, ratio, seconds=2.5, onset=1.0, **channels):
    """When a slip that gets faster is told, s, at a ratio of the forces; None where it is not."""
    fusion = SlipFusion()
    fusion.reset(expected)
    for time in np.arange(0.0, seconds, 0.01):
        since = max(time - onset, 0.0)
        vibration = np.exp(rng.normal(0.0, 0.25) + min(3.0 * since, 1.0))
        measured = ratio * min(1.0, 0.6 + 0.4 * time) + rng.normal(0.0, 0.01)
        path = 4e-3 * since**2 + rng.normal(0.0, 3e-5)
        seen = {"vibration": vibration, "electrodes": rng.normal(0.2, 0.3), "path": path} | channels
        if fusion.update(time, SlipObservation(ratio=measured, **seen)).slipping:
            return float(time)
    return None


def test_a_slip_is_told_sooner_where_earlier_ones_say_that_it_is_due():
    rng = np.random.default_rng(3)
    due, unknown, far_off = (
        np.array([slow_slip(rng, expected, ratio=0.7) for _ in range(30)], dtype=float)
        for expected in (0.7, None, 1.0)
    )
    assert np.all(due > 0.8)
    assert np.median(due) <= np.median(unknown) - 0.03
    assert np.median(far_off) >= np.median(unknown) + 0.03
    assert not np.any(np.isnan(far_off)), "told late, but told"


@pytest.mark.parametrize("channels", [{}, {"vibration": None}, {"electrodes": None}])
def test_forces_alone_tell_no_slip(channels):
    """A surface that holds better than the one before is at rest, however hard it is pulled."""
    rng = np.random.default_rng(4)
    resting = {"seconds": 20.0, "onset": 1e9} | channels
    told = [slow_slip(rng, expected=0.4, ratio=0.7, **resting) for _ in range(4)]
    assert told == [None] * 4


def test_the_slip_is_found_where_the_ratio_of_the_forces_peaks():
    """Creep before the slip and noise of a few hundredths of a newton do not mislead."""
    rng, ratios, times = np.random.default_rng(2), [], []
    time = np.arange(0.0, 0.5, 0.01)
    for _ in range(40):
        after = np.maximum(time - 0.33, 0.0)
        normal = 1.4 - 1.2 * np.minimum(time, 0.4)
        ratio = 0.55 + 0.2 * np.minimum(time, 0.33) - np.minimum(after, 0.1)
        forces = normal, ratio * normal
        normal, tangential = (f + rng.normal(0.0, 0.015, len(time)) for f in forces)
        near = find_slip(normal, tangential)
        ratios.append(tangential[near].mean() / normal[near].mean())
        times.append(time[near].mean())
    assert np.median(times) == pytest.approx(0.33, abs=0.04)
    assert np.mean(ratios) == pytest.approx(0.616, rel=0.015)
    assert np.std(ratios) < 0.015


def draw_events(mu, rng, count=8, tilt=(0.0, 0.0), scatter=0.01, **changes):
    angles = probing_angles(count)
    ratios = mu + (1 + mu**2) * (tilt[0] * np.cos(angles) + tilt[1] * np.sin(angles))
    ratios = ratios + rng.normal(0.0, scatter, count)
    return [
        SlipEvent(float(k), "body", float(a), 1.0, float(r), 0.01, kinetic=0.9 * mu, **changes)
        for k, (a, r) in enumerate(zip(angles, ratios, strict=True))
    ]


def test_errors_of_the_direction_cancel_between_opposite_slips():
    events = draw_events(0.7, np.random.default_rng(3), tilt=(0.08, -0.05), scatter=0.0)
    found = estimate_friction(events)["body"]
    assert found.static == pytest.approx(0.7, abs=1e-3)
    np.testing.assert_allclose(found.tilt, [0.08, -0.05], atol=5e-3)
    assert found.kinetic == pytest.approx(0.63)


def test_intervals_cover_at_their_rate():
    rng = np.random.default_rng(4)
    config = FrictionEstimateConfig(gain_std=0.02)
    covered = 0
    for _ in range(300):
        mu = rng.uniform(0.3, 1.1)
        gain = 1.0 + 0.02 * rng.standard_normal()
        tilt = np.deg2rad(4.0) * rng.standard_normal(2)
        found = estimate_region(
            "body", draw_events(mu * gain, rng, tilt=tilt, scatter=0.02), config
        )
        covered += found.interval[0] <= mu <= found.interval[1]
    assert 0.91 <= covered / 300 <= 0.995


def test_one_false_slip_does_not_spoil_the_estimate():
    events = draw_events(0.7, np.random.default_rng(5), count=10)
    events.append(SlipEvent(99.0, "body", 0.3, 1.5, 0.2, 0.01))
    assert estimate_friction(events)["body"].static == pytest.approx(0.7, abs=0.03)


def test_a_moving_normal_is_said_and_widens_the_interval():
    still = estimate_friction(draw_events(0.6, np.random.default_rng(6)))["body"]
    tilted = draw_events(0.6, np.random.default_rng(6), tilt=(0.3, 0.0))
    warped = estimate_friction(tilted)["body"]
    assert not still.normal_moves
    assert warped.normal_moves
    assert warped.width > 3 * still.width


def test_a_single_slip_is_not_enough():
    with pytest.raises(NotIdentifiableError, match="1 slips"):
        estimate_region(
            "body", draw_events(0.5, np.random.default_rng(7))[:1], FrictionEstimateConfig()
        )


def test_balanced_forces_make_the_wanted_wrench():
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.04, 0.0], [0.06, 0.02, 0.01]])
    normals = np.array([[1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0]])
    wrench = np.array([0.01, -0.005, 0.02, 0.3, -0.2, 0.5])
    forces = balance_forces(points, normals, np.array([0.8, 0.8, 2.0]), wrench)
    found = total_wrench(points, forces, points.mean(axis=0))
    np.testing.assert_allclose(found, wrench, atol=1e-5)
    pressing = np.einsum("ki,ki->k", forces, normals)
    assert np.all(pressing > 0.2)


@pytest.fixture(scope="module")
def kinematics():
    return HandKinematics()


def test_joint_targets_give_the_wanted_force_through_the_drives(kinematics):
    """tau = kp (q_d - q) has to be J^T f beyond what held the finger before."""
    positions = ROBOT.start
    config = ImpedanceConfig(posture=0.0, force_gain=0.0, damping=0.0, joint_rate=6.0)
    impedance = FingertipImpedance(kinematics, "index", config)
    pressing = np.array([0.1, 0.0, -0.4])
    impedance.begin(positions, positions, pressing)
    wanted = np.array([0.3, -0.2, -0.9])
    for _ in range(50):
        targets = impedance.command(0.01, positions, wanted, wanted)
    tip = impedance.tip(positions)
    jacobian = kinematics.jacobian("index", positions, tip)[3:, 7:11]
    kp = np.array([joint.kp for joint in ROBOT.hand_joints[:4]])
    np.testing.assert_allclose(
        kp * (targets - positions[7:11]), jacobian.T @ (wanted - pressing), atol=1e-9
    )


def test_taking_over_moves_nothing_and_limits_hold(kinematics):
    positions = ROBOT.start
    targets = positions.copy()
    targets[7:11] += [0.0, 0.02, 0.02, 0.01]
    impedance = FingertipImpedance(kinematics, "index")
    force = np.array([0.0, 0.1, -0.5])
    impedance.begin(positions, targets, force)
    np.testing.assert_allclose(
        impedance.command(0.01, positions, force, force), targets[7:11], atol=1e-9
    )
    before = targets[7:11]
    for _ in range(100):
        now = impedance.command(0.01, positions, np.array([0.0, 0.0, -50.0]), force)
        assert np.all(np.abs(now - before) <= 0.03 + 1e-12)
        before = now
    torque = np.array([j.kp for j in ROBOT.hand_joints[:4]]) * (now - positions[7:11])
    assert np.all(np.abs(torque) <= [j.effort for j in ROBOT.hand_joints[:4]])


def held_hand(kinematics, forces):
    """A hand around a box whose surface runs through the fingertips."""
    positions = ROBOT.start
    sensors = kinematics.locate(positions).sensors
    contacts = {
        finger: ProbeContact(sensors[k, :3, 3], force * UP, np.full(3, 0.03))
        for k, (finger, force) in enumerate(forces.items())
        if force
    }
    return ProbeInput(0.0, 0.0, positions, contacts, np.eye(4))


def test_an_object_that_is_not_held_is_refused_with_the_finger(kinematics):
    probe = FrictionProbe(kinematics, ObjectSurface.from_mapping(BOX))
    loose = held_hand(kinematics, {"index": 0.5, "middle": 0.5, "ring": 0.0, "thumb": 1.0})
    with pytest.raises(NotIdentifiableError, match="not held, ring"):
        probe.start(loose, loose.positions)
    assert probe.phase is ProbePhase.IDLE


def test_stale_touch_ends_the_probe_with_the_grip_from_before(kinematics):
    probe = FrictionProbe(kinematics, ObjectSurface.from_mapping(BOX))
    seen = held_hand(kinematics, {"index": 0.5, "middle": 0.5, "ring": 0.5, "thumb": 1.0})
    targets = seen.positions + 0.01
    probe.start(seen, targets)
    for k in range(1, 300):
        later = ProbeInput(0.01 * k, min(0.01 * k, 0.1), seen.positions, seen.contacts, np.eye(4))
        told = probe.update(later)
    assert probe.phase is ProbePhase.FAILED
    assert "stale" in probe.outcome
    np.testing.assert_allclose(told, targets)


def test_a_moving_object_and_too_much_force_end_the_probe(kinematics):
    seen = held_hand(kinematics, {"index": 0.5, "middle": 0.5, "ring": 0.5, "thumb": 1.0})
    moved = np.eye(4)
    moved[0, 3] = 0.05
    strong = {**seen.contacts, "thumb": ProbeContact(np.zeros(3), 9.0 * UP, np.ones(3))}
    for contacts, pose, reason in ((seen.contacts, moved, "moved"), (strong, np.eye(4), "9.0 N")):
        probe = FrictionProbe(kinematics, ObjectSurface.from_mapping(BOX))
        probe.start(seen, seen.positions)
        probe.update(ProbeInput(0.01, 0.01, seen.positions, contacts, pose))
        assert probe.phase is ProbePhase.RESTORE
        assert reason in probe.outcome


def test_the_configuration_names_what_is_wrong():
    for finger in ("thumb", "little"):
        with pytest.raises(BadInputError, match=f"'{finger}': expected one of index, middle, ring"):
            config = FrictionProbeConfig(finger=finger)
            FrictionProbe(HandKinematics(), ObjectSurface.from_mapping(BOX), config)
    with pytest.raises(BadInputError, match="variant"):
        FrictionProbeConfig(variant="sideways")
