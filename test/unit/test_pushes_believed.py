"""The graph network learns from pushes that a filter chooses, and from what it believes of them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from tactile_dynamics_ros.cli import train_pushing_rounds as rounds
from tactile_dynamics_ros.core.planar.network import believed, training
from tactile_dynamics_ros.core.planar.network.graph import MOTION


@pytest.fixture(scope="module")
def pushes():
    patch = pytest.MonkeyPatch()
    patch.setattr(rounds, "_CANDIDATES", 3)
    (found,) = rounds.candidate_pushes("single", [200_003], rounds.SETTINGS["slow"])
    patch.undo()
    return found


def test_a_filter_expects_more_of_a_push_the_more_of_it_there_is(pushes):
    push = pushes[0]
    process = push.mechanics
    covariance = process.prior[1][:4, :4]
    gains = []
    for count in (2, 7, None):  # the tip stands for the first two steps
        told = believed.expected_information(process, replace(push, sensed=push.sensed[:count]))
        left = np.linalg.inv(np.linalg.inv(covariance) + told)
        gains.append(0.5 * np.log(np.linalg.det(covariance) / np.linalg.det(left)))
    assert gains[0] < 0.5 < gains[1] < gains[2]
    assert np.sqrt(left[0, 0]) < 0.3 * np.sqrt(covariance[0, 0])


def test_pushes_that_tell_the_same_are_not_taken_twice(pushes, monkeypatch):
    told = [np.diag([1e4, 0.0, 0, 0]), np.diag([9e3, 0.0, 0, 0]), np.diag([0, 9.0, 0, 0])]
    monkeypatch.setattr(rounds, "expected_information", lambda _, push: told[pushes.index(push)])
    process = pushes[0].mechanics
    monkeypatch.setattr(rounds.GraphProcess, "of", lambda *_: process)
    chosen = rounds.most_telling(pushes, None, 2)
    assert [pushes.index(push) for push in chosen] == [0, 2]
    given = [SimpleNamespace()] * 7
    monkeypatch.setattr(rounds, "most_telling", lambda them, _, count: them[-count:])
    assert rounds._chosen("gain", given, object()) == given[-5:]


def test_what_is_believed_holds_no_truth_and_comes_near_to_it(pushes):
    blind = [
        replace(
            push,
            steps=replace(
                push.steps,
                parameters=push.steps.parameters * np.nan,
                states=push.steps.states * np.nan,
                after=push.steps.after * np.nan,
                force=push.steps.force * np.nan,
            ),
            sensed=[replace(step, truth=step.truth * np.nan) for step in push.sensed],
            given=[replace(step, truth=step.truth * np.nan) for step in push.given],
        )
        for push in pushes
    ]
    found = believed.believed_steps(blind, 0)
    for one, push in zip(found, pushes, strict=True):
        off = one.parameters[0] - push.steps.parameters[0]
        assert abs(off[0]) < 0.2
        assert np.linalg.norm(off[2:4]) < 0.01
        assert np.all(one.noise.motion > 1e-4)
        assert np.all(one.noise.motion[:, 0, :2] < 0.01)
        rate = rounds.SETTINGS["slow"].period
        places = (one.after - one.states)[:, :2] / rate
        assert_allclose(places, one.after[:, 3:5], atol=0.01)
    examples = rounds._joined(found, rounds.SETTINGS["slow"])
    assert examples.noise.motion.shape == examples.motion.shape
    assert np.all(examples.noise.force > 0.0)


def test_the_noise_of_an_observation_adds_to_the_spread_that_is_predicted():
    process, touch = torch.zeros(1, 1, 2 * MOTION), torch.zeros(1, 4)
    process[..., MOTION:], touch[..., 2:] = np.log(0.3), np.log(0.3)
    motion, force = torch.full((1, 1, MOTION), 0.5), torch.full((1, 2), 0.5)

    def loss(noise):
        told = (motion, torch.full_like(motion, noise)), (force, torch.full_like(force, noise))
        return float(training.step_loss(process, touch, *told))

    for noise in (0.0, 0.4):
        spread = np.hypot(0.3, noise)
        surprise = 0.5 * (0.5 / spread) ** 2 + np.log(spread)
        assert loss(noise) == pytest.approx(2.0 * (0.125 + surprise * spread), rel=1e-5)
