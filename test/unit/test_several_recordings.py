"""Several recordings of one object: body and effects are shared, biases are of each."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.carried import CarriedOptions, generate_carried
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.effects.check import example_samples
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.batch import fit_recording
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import WrenchProblem
from tactile_dynamics_ros.core.streams.joining import PAUSE, join_streams
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic.recordings import write_bag

SHORT = CarriedOptions(duration=10.0)


def biased(seed, bias, hidden=None):
    streams = generate_carried(seed, replace(SHORT, drawn=False), hidden).streams
    contact = streams.contacts["finger_1"]
    extra = streams.pose.rotation @ np.array(bias)
    moved = replace(contact, force=contact.force + extra)
    return replace(streams, contacts=streams.contacts | {"finger_1": moved})


def drag(motion):
    return np.concatenate([np.zeros_like(motion.velocity), -0.8 * motion.velocity], axis=1)


def test_recordings_follow_each_other_after_a_pause():
    first, second = (generate_carried(seed, SHORT).streams for seed in (1, 2))
    joined = join_streams([first, second])
    assert joined.session_starts == (0.0, pytest.approx(9.98 + PAUSE))
    assert len(joined.pose.time) == len(first.pose.time) + len(second.pose.time)
    assert np.all(np.diff(joined.pose.time) > 0.0)
    samples = WrenchProblem.from_streams(joined).measured
    assert np.bincount(samples.session).tolist() == pytest.approx([493, 493], abs=8)
    gap = np.diff(samples.time).max()
    assert gap == pytest.approx(PAUSE, abs=0.5)
    assert np.abs(samples.velocity).max() < 1.0
    assert join_streams([first]) is first


def test_a_contact_that_one_recording_lacks_does_not_touch_there():
    first, second = (generate_carried(seed, SHORT).streams for seed in (1, 2))
    fewer = {name: c for name, c in second.contacts.items() if name != "finger_2"}
    joined = join_streams([first, replace(second, contacts=fewer), first])
    samples = WrenchProblem.from_streams(joined).measured
    touching = samples.in_contact[:, samples.contact_names.index("finger_2")]
    assert [touching[samples.session == k].mean() for k in range(3)] == [1.0, 0.0, 1.0]


def test_recordings_of_different_kinds_are_refused():
    streams = generate_carried(1, SHORT).streams
    with pytest.raises(BadInputError, match="some of the 2 recordings have pose samples"):
        join_streams([streams, replace(streams, pose=None)])


def test_a_bias_acts_in_its_own_recording_only():
    samples = replace(example_samples(), session_starts=(0.0, 1.0))
    effect = create_effect("force_bias:thumb")
    names = [p.name for p in effect.parameters(samples)]
    assert names == [f"thumb_b[{k}]_{axis}" for k in (1, 2) for axis in "xyz"]
    theta = np.array([0.3, 0.0, 0.0, 0.0, 0.0, -0.2])
    plain = replace(samples, session_starts=())
    found = effect.wrench(samples, np.zeros(10), theta)
    for session in (0, 1):
        rows = samples.session == session
        assert rows.any()
        own = effect.wrench(plain, np.zeros(10), theta[3 * session : 3 * session + 3])
        np.testing.assert_allclose(found[rows], own[rows])
        np.testing.assert_allclose(effect.jacobian(samples, np.zeros(10), theta) @ theta, found)


def test_body_and_drag_are_shared_and_biases_are_told_apart():
    parts = [biased(7, (0.3, 0.0, 0.0), drag), biased(8, (-0.2, 0.1, 0.0), drag)]
    effects = [create_effect("viscous_drag"), create_effect("force_bias:finger_1")]
    alone = fit_recording(parts[0], effects).to_estimate()
    both = fit_recording(join_streams(parts), effects).to_estimate()
    assert both.parameter_std[0] < 0.8 * alone.parameter_std[0]
    assert both.inertia.mass == pytest.approx(0.25, abs=4.0 * both.parameter_std[0])
    drags = both.effects["viscous_drag"]
    assert drags.value["c"] == pytest.approx(0.8, abs=4.0 * drags.std["c"])
    bias = both.effects["force_bias"]
    for name, true in {"b[1]_x": 0.3, "b[1]_y": 0.0, "b[2]_x": -0.2, "b[2]_y": 0.1}.items():
        key = f"finger_1_{name}"
        assert bias.value[key] == pytest.approx(true, abs=4.0 * bias.std[key])
        assert bias.std[key] < 0.02


def test_verbs_take_several_recordings(tmp_path, capsys):
    bags = []
    for seed, bias in ((7, (0.3, 0.0, 0.0)), (8, (-0.2, 0.1, 0.0))):
        bags.append(str(write_bag(biased(seed, bias), tmp_path / str(seed))))
    assert main(["diagnose", *bags, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["effect"]) == ("missing_effect", "force_bias")
    assert main(["estimate", *bags, "--effects", "force_bias:finger_1", "--json"]) == 0
    assert "finger_1_b[2]_x" in json.loads(capsys.readouterr().out)["effects"]["force_bias"]
    assert main(["estimate", *bags, "--between", "0,5"]) == 2
    assert "--between cuts one recording; 2 are given" in capsys.readouterr().err


def test_joined_recordings_name_their_sources():
    parts = [Recording(generate_carried(seed, SHORT).streams, f"bag {seed}") for seed in (1, 2)]
    assert Recording.join(parts).source == "bag 1 + bag 2"
    assert Recording.join(parts[:1]) is parts[0]
