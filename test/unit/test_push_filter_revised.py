"""A filter of two parts that goes through its pushes once more, around what they told."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.planar.filter import revised
from tactile_dynamics_ros.core.planar.filter.dual import DualConfig, DualFilter
from tactile_dynamics_ros.core.planar.filter.linked_patch import LinkedPatchProcess
from tactile_dynamics_ros.core.planar.filter.observation import MeasuredWrench, Observation
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import Prediction, PusherMotion
from tactile_dynamics_ros.core.planar.filter.revised import RevisedFilter, filter_of

GOING = PusherMotion(np.zeros(3), np.array([1e-4, 0.0, 0.0]), 0.01, touching=True)
BLOCK = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])


@dataclass(frozen=True)
class ContactForce:
    """Standing parts of which a force is measured that follows from the parameters alone."""

    links: int = 1
    names: tuple[str, ...] = ("ln_product", "ln_mass", "com_x", "com_y")

    def feasible(self, parameters):
        """All of them."""
        return np.ones(len(parameters), dtype=bool)

    def acting(self, states, parameters):
        """One by one."""
        return parameters, ()

    def predict(self, states, parameters, motion):
        """The same states, and what is measured."""
        return Prediction(states.copy(), self.measured(parameters, motion.link))


class Linear(ContactForce):
    """The force is linear in the parameters."""

    @property
    def prior(self):
        """With a correlation."""
        root = np.diag([0.5, 0.3, 0.2, 0.4])
        root[1, 0] = 0.2
        return np.zeros(4), root @ root.T

    def measured(self, parameters, link):
        """Two numbers of three parameters."""
        by = np.array([[1.0, 0.5, 0.0, 0.0], [0.0, 1.0, -0.5, 0.0], [0.0, 0.0, 0.0, 0.0]])
        return parameters @ by.T


class Sum(ContactForce):
    """Friction of two parts and its torque: only their sum and its centre act.

    Parameters are ln of both frictions, and how far the first one's centre lies towards the second
    as pushes on the first and on the second part meet it.
    """

    @property
    def prior(self):
        """Parts of half a newton, known to a factor of two, and centres known to a tenth."""
        return np.log([0.5, 0.5, 1.0, 1.0]), np.diag(np.square([0.6, 0.6, 0.1, 0.1]))

    def measured(self, parameters, link):
        """Sum, and torque about the first part's middle with the second at a distance of 1."""
        one, two = np.exp(parameters[:, :2].T)
        torque = two + one * parameters[:, 2 + link]
        return np.column_stack([one + two, torque, np.zeros(len(one))])


def pushed(found, truth, steps, std=0.03, seed=0):
    """Let a filter feel a push on each part with noise, and rest after each."""
    rng = np.random.default_rng(seed)
    for link in (0, 1):
        value = found.process.measured(truth[None], link)[0, :2]
        for _ in range(steps):
            noisy = MeasuredWrench(value + std * rng.normal(size=2), np.full(2, std))
            found.step(replace(GOING, link=link), Observation((), noisy))
        found.step(None, Observation())
    return found


def made(kind, process, seed=0):
    """A filter on an even table."""
    config = DualConfig(variation=1e-6, hypotheses=200, seed=seed)
    return kind(process, np.zeros(3), np.array([1e-3, 1e-3, 0.01]), config)


def test_of_a_linear_model_the_second_pass_tells_what_the_first_did(monkeypatch):
    truth = np.array([0.6, 0.3, -0.3, 0.2])
    plain = pushed(made(DualFilter, Linear()), truth, 30, std=0.3)
    monkeypatch.setattr(revised, "_MOVED", 1e9)
    kept = pushed(made(RevisedFilter, Linear()), truth, 30, std=0.3)
    assert not kept.revise()
    monkeypatch.setattr(revised, "_MOVED", 0.01)
    assert kept.revise()
    for mine, its in zip(kept.parameters, plain.parameters, strict=True):
        assert_allclose(mine, its, atol=2e-4)
    assert np.abs(plain.parameters[0][0]) > 0.3  # around which the second pass began


def off(found, truth):
    """Largest error of a parameter over its standard deviation."""
    mean, covariance = found.parameters
    return np.abs((mean - truth) / np.sqrt(np.diag(covariance))).max()


def test_a_second_part_that_is_lighter_than_thought_is_not_told_too_surely():
    truth = np.array([0.2, np.log(0.2), 0.15, -0.1])  # the first touch tells 0.4 of the second part
    errors = {
        kind: [off(pushed(made(kind, Sum(), seed), truth, 40, seed=seed), truth) for seed in (1, 2)]
        for kind in (DualFilter, RevisedFilter)
    }
    assert min(errors[DualFilter]) > 3.5
    assert max(errors[RevisedFilter]) < 2.0


def test_what_was_informed_stays_when_steps_are_gone_through_once_more(monkeypatch):
    found = pushed(made(RevisedFilter, Linear()), np.array([0.6, 0.3, -0.3, 0.2]), 30)
    known = np.array([-0.2, 0.1, 0.0, 0.0]), 1e-4 * np.eye(4)
    found.inform(*known)
    monkeypatch.setattr(revised, "_MOVED", -1.0)
    assert found.revise()
    assert_allclose(found.parameters[0], known[0], atol=1e-9)
    assert_allclose(found.parameters[1], known[1], atol=1e-9)


def test_a_long_recording_is_not_gone_through_once_more(monkeypatch):
    found = pushed(made(RevisedFilter, Linear()), np.array([0.6, 0.3, -0.3, 0.2]), 5)
    monkeypatch.setattr(revised, "_MOVED", -1.0)
    monkeypatch.setattr(revised, "_LONGEST", 5)  # beside steps of rest
    before = found.belief
    assert not found.revise()
    assert found.belief is before


@pytest.mark.parametrize(("count", "kind"), [(1, DualFilter), (2, RevisedFilter)])
def test_filters_of_two_parts_revise(count, kind):
    process = LinkedPatchProcess((PatchProcess(BLOCK),) * count, np.array([0.05, 0.0]))
    found = filter_of(process, np.zeros(3 * count), np.array([1e-3, 1e-3, 0.01]))
    assert type(found) is kind
