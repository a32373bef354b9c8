"""Every hidden effect of the simulated sensors changes readings as its formula says."""

import dataclasses

import numpy as np
import pytest
from free_body import POSE, attached, value, wrench_in_one_step
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.sim.bodies import ContactReading
from tactile_dynamics_ros.sim.hidden_effects import (
    CATALOGUED,
    OUTSIDE,
    SensorView,
    create_hidden_effect,
)

FINGERS = ("index", "middle", "ring", "thumb")


def view(time=0.0, force=(0.5, -0.2, 2.0)):
    rotation = {
        f: Rotation.from_rotvec([0.3 * k, 0.2, 0.1]).as_matrix() for k, f in enumerate(FINGERS)
    }
    contacts = {
        finger: ContactReading(
            finger, time, True, rotation[finger] @ force, np.zeros(3), np.ones(3), np.ones(3), 1.0
        )
        for finger in FINGERS
    }
    contacts["other"] = dataclasses.replace(contacts["index"], name="other")
    return SensorView(time, contacts, rotation, POSE)


def measured(effect, time=0.0, force=(0.5, -0.2, 2.0)):
    """Reported forces (4, 3) in the sensors' axes."""
    seen = view(time, force)
    readings = effect.feel(seen)
    assert readings["other"] is seen.contacts["other"]
    return np.array([seen.sensor_rotation[f].T @ readings[f].force for f in FINGERS])


def rows(effect, name):
    return np.array([effect.truth()[f"{finger}.{name}"]["value"] for finger in FINGERS])


def test_bias_is_added_in_sensor_axes():
    effect = attached("force_bias")
    assert measured(effect) - [0.5, -0.2, 2.0] == pytest.approx(rows(effect, "bias"))
    assert np.abs(rows(effect, "bias")).max() > 0.05


def test_drift_grows_linearly():
    effect = attached("force_drift")
    assert measured(effect, 0.0) == pytest.approx(np.tile([0.5, -0.2, 2.0], (4, 1)))
    assert measured(effect, 10.0) - [0.5, -0.2, 2.0] == pytest.approx(10.0 * rows(effect, "rate"))


def test_scale_multiplies():
    effect = attached("force_scale")
    gain = 1.0 + rows(effect, "gain_error")
    assert measured(effect) == pytest.approx(gain[:, None] * [0.5, -0.2, 2.0])


def test_rotated_sensor_keeps_the_size_of_the_force():
    effect = attached("sensor_rotation")
    turned = Rotation.from_rotvec(rows(effect, "rotation")).apply([0.5, -0.2, 2.0])
    assert measured(effect) == pytest.approx(turned)
    assert np.linalg.norm(measured(effect), axis=1) == pytest.approx(np.sqrt(4.29))


def test_lag_answers_a_ramp_late_by_its_time_constant():
    effect = attached("sensor_lag")
    for time in np.arange(0.0, 1.0, 0.01):
        reported = measured(effect, time, (time, 2 * time, 3 * time))
    assert reported == pytest.approx(np.tile((time - 0.03) * np.array([1, 2, 3]), (4, 1)), rel=1e-6)


def test_time_offset_delays_touch_only():
    effect = attached("time_offset")
    assert abs(effect.delay("touch")) == pytest.approx(0.02)
    assert effect.delay("pose") == 0.0


def test_contact_offset_moves_points_with_the_object():
    effect = attached("contact_offset")
    (name,) = effect.truth()
    finger = name.split(".")[0]
    shift = POSE[:3, :3] @ value(effect, name)
    assert np.linalg.norm(shift) == pytest.approx(0.008)
    moved = {key: reading.point - np.ones(3) for key, reading in effect.feel(view()).items()}
    assert moved.pop(finger) == pytest.approx(shift)
    assert np.all(np.array(list(moved.values())) == 0.0)


def test_creep_relaxes_under_load_and_recovers():
    effect = attached("skin_creep")
    loaded = [measured(effect, time)[0, 2] for time in np.arange(0.0, 60.0, 0.05)]
    released = measured(effect, 60.0, (0.0, 0.0, 0.0))[0, 2]
    assert loaded[0] == pytest.approx(2.0)
    assert np.all(np.diff(loaded) < 0)
    assert loaded[-1] == pytest.approx(2.0 * 0.7, abs=0.04)
    assert released < -0.4


def test_temperature_step_settles():
    effect = attached("temperature_step")
    assert measured(effect, 5.0)[0] == pytest.approx([0.5, -0.2, 2.0])
    assert np.linalg.norm(measured(effect, 60.0)[0] - [0.5, -0.2, 2.0]) == pytest.approx(0.4)


def test_dead_zone_shrinks_every_axis():
    assert measured(attached("dead_zone"))[0] == pytest.approx([0.25, 0.0, 1.75])


def test_cross_talk_mixes_neighbours_in_sensor_axes():
    assert measured(attached("cross_talk")) == pytest.approx(np.tile([0.6, -0.24, 2.4], (4, 1)))


def test_backlash_lags_by_half_its_play():
    effect = attached("pose_backlash")
    there = [effect.see(_shifted(x), 0.0)[0, 3] for x in (0.0, 0.005, 0.01)]
    back = [effect.see(_shifted(x), 0.0)[0, 3] for x in (0.009, 0.008, 0.005)]
    assert np.array(there) - POSE[0, 3] == pytest.approx([0.0, 0.0035, 0.0085])
    assert np.array(back) - POSE[0, 3] == pytest.approx([0.0085, 0.0085, 0.0065])


def _shifted(x):
    pose = POSE.copy()
    pose[0, 3] += x
    return pose


@pytest.mark.parametrize("name", CATALOGUED + OUTSIDE)
def test_nothing_happens_at_magnitude_zero(name):
    effect = create_hidden_effect(name, 0.0, seed=3)
    assert wrench_in_one_step(effect) == pytest.approx(np.zeros(6), abs=1e-9)
    assert measured(effect) == pytest.approx(np.tile([0.5, -0.2, 2.0], (4, 1)))
    assert effect.see(POSE, 0.0) == pytest.approx(POSE)
    assert effect.delay("touch") == 0.0
