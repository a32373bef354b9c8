"""Which motions tell rival explanations apart."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np

from tactile_dynamics_ros.core.effects.check import example_inertia, example_samples
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.inertia.diagnosis.separating_motion import Rival, SeparationCriterion
from tactile_dynamics_ros.core.inertia.excitation.limits import Grip
from tactile_dynamics_ros.core.inertia.excitation.trajectory import FourierOffsets, HeldPose

FORCE_STD = 0.03


def rival(label: str, theta: list[float]) -> Rival:
    effect = create_effect(label)
    stds = [p.prior_std for p in effect.parameters(example_samples())]
    prior = np.concatenate([np.full(10, 1e-9), np.array(stds) ** -2.0])
    return Rival(example_inertia(), (effect,), (np.array(theta),), np.diag(prior))


def slowed(factor: float):
    """The example's poses passed through more slowly."""
    samples = example_samples(2000)
    return dataclasses.replace(
        samples,
        velocity=factor * samples.velocity,
        acceleration=factor**2 * samples.acceleration,
        angular_velocity=factor * samples.angular_velocity,
        angular_acceleration=factor**2 * samples.angular_acceleration,
    )


def test_two_laws_of_drag_differ_more_when_speeds_differ_more():
    criterion = SeparationCriterion(
        rival("viscous_drag", [0.3]), ((rival("quadratic_drag", [0.3]),),), FORCE_STD
    )
    slow, fast = (float(criterion.gaps(slowed(f))[0]) for f in (0.1, 1.0))
    assert fast > 10.0 * slow
    assert fast > 30.0


def test_no_motion_refutes_a_rival_that_contains_the_best():
    """A hanging cable is a spring without stiffness, and no spring is a cable."""
    cable = rival("hanging_cable", [0.1, 0.2, -0.3, 0.0, 0.02, 0.01])
    spring = rival("tether_spring", [2.0, 0.1, 0.2, -0.3, 0.0, 0.02, 0.01])
    samples = slowed(1.0)
    contained, refuted = (
        float(SeparationCriterion(best, ((other,),), FORCE_STD).gaps(samples)[0])
        for best, other in ((cable, spring), (spring, cable))
    )
    assert contained < 1.0
    assert refuted > 30.0


def test_a_short_lag_is_a_delay_however_coarse_the_samples():
    """Coarse samples promise hardly more of a difference than fine ones."""
    samples = example_samples(2000)
    grip = Grip.from_samples(samples, example_inertia(), 0.8)
    start = HeldPose(samples.rotation[0], samples.position[0], samples.position[0])
    waves = np.full((6, 2), 0.02)
    offsets = FourierOffsets(10.0, np.array([0.6, 2.5]), waves, waves)
    late, lagging = rival("time_offset", [0.005]), rival("sensor_lag", [0.005])
    gaps = []
    for rate in (20.0, 100.0):
        moved = start.follow(offsets, np.arange(0.0, 10.0, 1.0 / rate))
        criterion = SeparationCriterion(late, ((lagging,),), FORCE_STD, rate)
        gaps.append(float(criterion.gaps(grip.load(moved, example_inertia()))[0]))
    assert gaps[0] < 2.0 * gaps[1]


def test_more_motion_never_counts_more_than_what_is_decisive():
    others = ((rival("quadratic_drag", [0.3]),), (rival("rotational_drag", [0.01]),))
    criterion = SeparationCriterion(rival("viscous_drag", [0.3]), others, FORCE_STD)
    assert criterion(slowed(1.0)) >= -2 * 2 * 30.0
    assert criterion(slowed(1.0)) <= criterion(slowed(0.05))


def test_a_rival_may_need_other_fingers_in_the_new_recording():
    """What a bias of one finger cannot follow, biases of several can: no motion refutes those."""
    samples = dataclasses.replace(slowed(0.3), in_contact=slowed(0.3).in_contact | True)
    push = rival("unsensed_contact", [0.3, -0.2, 0.4, 0.02, 0.01, -0.03])
    thumb = create_effect("force_bias:thumb")
    fitted = SimpleNamespace(
        phi=example_inertia(),
        effects=(thumb,),
        theta=(np.array([0.3, -0.2, 0.4]),),
        samples=samples,
        time=np.zeros(6),
        evaluated=(np.zeros(6), np.zeros((6, 13))),
    )
    alone, *free = Rival.readings_of(fitted)
    assert [reading.effects[0].label for reading in free] == ["force_bias", "force_bias:@sensor"]
    first, wrench = alone.wrench(samples), free[0].wrench(samples)
    np.testing.assert_allclose(wrench, first, atol=1e-12)
    gap_alone, gap = SeparationCriterion(push, ((alone,), (alone, *free)), FORCE_STD).gaps(samples)
    assert gap_alone > 30.0
    assert gap < 1.0


def fitted(label: str, theta: list[float], jacobian: np.ndarray) -> SimpleNamespace:
    rows = len(jacobian)
    return SimpleNamespace(
        phi=example_inertia(),
        effects=(create_effect(label),),
        theta=(np.array(theta),),
        samples=example_samples(),
        time=np.zeros(rows),
        evaluated=(np.zeros(rows), jacobian),
    )


def test_what_the_present_recording_tells_is_not_learned_anew():
    """A rival whose drag and load are known cannot adapt to a new recording that is slow."""
    samples = slowed(0.3)
    best = rival("viscous_drag", [0.02])
    vague = Rival.from_model(fitted("quadratic_drag", [0.02], np.zeros((22, 11))))
    known = Rival.from_model(fitted("quadratic_drag", [0.02], 1e4 * np.eye(11)))
    criterion = SeparationCriterion(best, ((vague,), (known,)), FORCE_STD)
    alone, together = criterion.gaps(samples)
    assert together > 2.0 * alone


def test_biases_of_the_present_recording_are_not_those_of_the_next():
    jacobian = np.random.default_rng(3).normal(size=(40, 13))
    found = Rival.from_model(fitted("force_bias:thumb", [0.1, 0.0, 0.2], jacobian))
    total = jacobian.T @ jacobian + np.diag([0.0] * 10 + [5.0**-2] * 3)
    beside = np.linalg.inv(np.linalg.inv(total)[:10, :10])
    np.testing.assert_allclose(found.prior[:10, :10], beside + 1e-9 * np.eye(10), rtol=1e-8)
    np.testing.assert_allclose(found.prior[10:, 10:], 5.0**-2 * np.eye(3))
    np.testing.assert_array_equal(found.prior[:10, 10:], 0.0)
