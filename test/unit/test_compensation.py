"""Contact wrenches without the load: motion so far, effects of the moment, changed loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_recording import COM, INERTIA_COM, MASS

from benchmarks.compensation import main, replay
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.compensation import Compensator, ContactWrenches, Load
from tactile_dynamics_ros.core.inertia.compensation.causal_motion import CausalMotion, ImuMotion
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
)
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.streams.streams import PoseStream

PHI = InertialParameters(MASS, COM, INERTIA_COM).dynamic_parameters
GRAVITY = np.array([0.0, 0.0, -9.81])


def body(**effects):
    return KnownBody(PHI, 1e-12 * np.eye(10), "box", (), effects, 1)


def swung(noise=1e-5, rate=500.0, seconds=3.0, seed=0):
    """A pose that swings along x and about z, its stamps, and accelerations along x."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    poses = np.tile(np.eye(4), (len(time), 1, 1))
    poses[:, :3, :3] = exp_so3(np.outer(0.3 * np.sin(4.0 * time), [0.0, 0.0, 1.0]))
    poses[:, 0, 3] = 0.05 * np.sin(5.0 * time)
    poses[:, :3, 3] += noise * rng.normal(size=(len(time), 3))
    return time, poses, -0.05 * 25.0 * np.sin(5.0 * time)


def test_acceleration_follows_the_poses_so_far_and_lags_by_what_is_said():
    time, poses, true = swung()
    motion, found, delay = CausalMotion(), [], []
    for now, pose in zip(time, poses, strict=True):
        motion.add(now, pose)
        found.append(motion.at(np.array([now])).acceleration[0, 0])
        delay.append(motion.acceleration_delay)
    late = time > 1.0
    assert motion.settled and 0.0 < np.median(delay) < 0.05
    lagging = np.interp(time - np.median(delay), time, true)
    assert np.sqrt(np.mean((np.array(found) - lagging)[late] ** 2)) < 0.05
    assert np.sqrt(np.mean((np.array(found) - true)[late] ** 2)) < 0.2


def test_noisier_poses_are_smoothed_for_longer():
    delays = []
    for noise in (1e-5, 1e-3):
        motion = CausalMotion()
        for now, pose in zip(*swung(noise)[:2], strict=True):
            motion.add(now, pose)
        delays.append(motion.acceleration_delay)
    assert delays[1] > 2.0 * delays[0]


def test_a_gap_begins_anew():
    motion = CausalMotion()
    for now, pose in zip(*swung()[:2], strict=True):
        motion.add(now, pose)
    motion.add(now + 0.5, np.eye(4))
    assert not motion.settled and motion.poses == 1


def test_an_imu_gives_the_acceleration_at_once():
    motion = ImuMotion()
    for now in np.arange(0.0, 1.0, 0.01):
        motion.add(now, np.eye(4))
        motion.feel(now, np.array([1.0, 0.0, 9.81]))
    np.testing.assert_allclose(motion.at(np.array([now])).acceleration[0], [1.0, 0.0, 0.0])
    assert motion.acceleration_delay == pytest.approx(0.005)


def test_effects_of_the_moment_are_taken_out_and_others_named():
    names = [p.name for p in _parameters_of("force_bias")]
    assert names, "one sensor of torques has a zero"
    zero = {name: {"value": 0.1} for name in names}
    known = body(force_bias=zero, sloshing_mass={}, sensor_lag={}, payload_change={})
    load = Load.of_body(known, ("wrist",))
    assert [effect.name for effect, _ in load.effects] == ["force_bias"]
    assert load.uncompensated == ("sloshing_mass", "sensor_lag", "payload_change")


def test_an_effect_without_its_parameters_is_refused():
    with pytest.raises(BadInputError, match="force_bias: no value of"):
        Load.of_body(body(force_bias={}), ("wrist",))


def _parameters_of(name):
    from tactile_dynamics_ros.core.effects import create_effect
    from tactile_dynamics_ros.core.inertia.compensation.compensator import _at_rest

    return create_effect(name).parameters(_at_rest(("wrist",)))


def resting(seconds=3.0, rate=200.0, extra=(0.0, 0.0, 0.0), since=1.5):
    """A wrist sensor that bears the box at rest, and something more from a time on."""
    time = np.arange(round(seconds * rate)) / rate
    count = len(time)
    zero, frames = np.zeros((count, 1, 3)), np.tile(np.eye(3), (count, 1, 1, 1))
    more = np.where(time > since, 1.0, 0.0)[:, None] * np.asarray(extra)
    force = (-MASS * GRAVITY - more)[:, None]
    torque = np.cross(COM, -MASS * GRAVITY) * np.ones((count, 1, 3))
    std = np.full((count, 3), 0.01)
    seen = ContactWrenches(
        time, ("wrist",), zero, frames, force, torque, np.ones((count, 1), bool), std
    )
    return PoseStream(time, np.zeros((count, 3)), frames[:, 0], None), seen


@pytest.mark.parametrize(
    ("extra", "changed"), [((0.0, 0.0, -1.0), True), ((1.0, 0.5, 0.0), False), ((0, 0, 0), False)]
)
def test_what_hangs_is_load_and_what_pushes_is_not(extra, changed):
    compensator = Compensator()
    compensator.load = Load.of_body(body(), ("wrist",))
    found, changes = replay(*resting(extra=extra), compensator)
    np.testing.assert_allclose(found[-1].wrench[0, 3:], extra, atol=1e-6)
    assert bool(changes[-1]) is changed
    if changed:
        assert changes[-1] == pytest.approx(1.0 / 9.81, rel=0.05)
        assert np.flatnonzero(changes)[0] / 200.0 < 1.5 + 1.0


def test_more_load_is_noticed_while_estimates_of_the_old_one_keep_coming():
    compensator, load = Compensator(), Load.of_body(body(), ("wrist",))
    poses, seen = resting(extra=(0.0, 0.0, -1.0))
    found = []
    for k, time in enumerate(seen.time):
        if k % 10 == 0:
            compensator.load = replace(load)
        pose = np.eye(4)
        compensator.motion.add(float(time), pose)
        at = slice(k, k + 1)
        compensator.compensate(
            ContactWrenches(seen.time[at], seen.names, *(p[at] for p in seen[2:]))
        )
        found.append(compensator.load_change)
    assert len(poses.time) == len(found) and found[-1] == pytest.approx(1.0 / 9.81, rel=0.05)


def test_the_benchmark_runs(capsys):
    assert main(["--start", "1", "--seeds", "1", "--kinds", "wrist:100", "--json"]) == 0
    assert '"force_removed": 0.9' in capsys.readouterr().out
