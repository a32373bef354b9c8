"""Estimates from poses before and after slow pushes, and from the work of fast ones."""

from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.support.residual_map import residual_map
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.sparse import fit as fit_module
from tactile_dynamics_ros.core.planar.sparse import fit_sparse, product_between_rests
from tactile_dynamics_ros.core.planar.sparse.pushes import cut_pushes
from tactile_dynamics_ros.recording.importers.goal_pushes_zhou2017 import (
    GoalPushesZhou2017Importer,
)
from tactile_dynamics_ros.recording.importers.pushes_mit import PushesMitImporter
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.scene import STEP

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
SLOW = pushed.ActionOptions(count=5, speed=(0.03, 0.04), travel=0.03, duration=1.0, pauses=0)
FAST = pushed.ActionOptions(count=2, speed=(0.2, 0.25), travel=0.15, pauses=0, gap=0.002)


def made(seed, actions):
    return pushed.generate([seed], options=pushed.PushOptions(actions=actions))[0]


def sparse(hidden):
    """Poses before and after each push alone."""
    link = hidden.streams.links[0]
    ends = link.time[0] + STEP * np.cumsum([len(action.path) for action in hidden.scene.actions])
    kept = [0, *(int(np.argmin(np.abs(link.time - end + 0.02))) for end in ends)]
    thin = replace(link, time=link.time[kept], pose=link.pose[kept])
    return replace(hidden.streams, links=(thin,))


@pytest.fixture(scope="module")
def hidden():
    return made(3, SLOW)


@pytest.fixture(scope="module")
def fit(hidden):
    return fit_sparse(sparse(hidden))


def test_poses_before_and_after_tell_friction_force_and_centre(hidden, fit):
    truth = hidden.truth()["links"][0]
    product, std = fit.friction_force
    assert len(fit.pushes) == SLOW.count
    assert fit.converged
    assert abs(product / truth["friction_force_n"] - 1.0) < 0.08
    assert abs(product - truth["friction_force_n"]) < 2.0 * std
    assert np.all(np.abs(fit.values[1:3] - truth["com"]) < 2.5 * fit.std[1:3])
    assert fit.std[1:3].max() < 0.01


def test_mass_and_friction_stay_undetermined(hidden, fit):
    truth = hidden.truth()["links"][0]
    assert fit.undetermined[:2] == ("mass", "friction")
    assert abs(fit.values[5] - np.log(truth["mass"])) < 2.0 * fit.std[5]
    assert fit.std[5] > 0.5


def test_without_forces_the_friction_force_is_undetermined(hidden, monkeypatch):
    monkeypatch.setattr(fit_module, "_STARTS", fit_module._STARTS[:1])
    monkeypatch.setattr(fit_module, "_ITERATIONS", 2)
    streams = sparse(hidden)
    silent = replace(streams.contacts["pusher"], time=np.zeros(0), force=np.zeros((0, 3)))
    found = fit_sparse(replace(streams, contacts={"pusher": silent}))
    assert "friction_force_n" in found.undetermined
    assert np.isfinite(found.values).all()


def test_work_between_rests_tells_friction_whatever_the_acceleration():
    hidden = made(7, FAST)
    truth = hidden.truth()["links"][0]
    force = np.linalg.norm(hidden.streams.contacts["pusher"].force[:, :2], axis=1)
    assert force.max() > 2.0 * truth["friction_force_n"]
    assert_allclose(product_between_rests(hidden.streams), truth["friction_force_n"], rtol=0.06)


def test_forces_of_the_wrong_sign_are_refused(hidden):
    contact = hidden.streams.contacts["pusher"]
    turned = {"pusher": replace(contact, force=-contact.force)}
    with pytest.raises(NotIdentifiableError, match="sign"):
        product_between_rests(replace(hidden.streams, contacts=turned))


def test_a_pusher_elsewhere_is_told(hidden):
    contact = hidden.streams.contacts["pusher"]
    away = {"pusher": replace(contact, point=contact.point + [0.3, 0.0, 0.0])}
    with pytest.raises(NotIdentifiableError, match="touches the outline"):
        cut_pushes(replace(sparse(hidden), contacts=away))


def test_the_map_names_the_direction_in_which_friction_differs(fit):
    """Forty made residuals; those of pushes along x, ten each way, are 0.2 higher."""
    rng = np.random.default_rng(5)
    many = fit.pushes.taken(np.arange(40) % len(fit.pushes))
    heading = 0.5 * np.pi * (np.arange(40) // 10)
    path = np.zeros((40, 2, 2))
    path[:, 1] = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    residuals = 0.03 * rng.normal(size=(40, 4))
    even = replace(fit, pushes=replace(many, path=path), residuals=residuals.copy())
    assert not any(d.stands_out for d in residual_map(even))
    residuals[heading % np.pi < 0.1, 0] += 0.2
    first, second = residual_map(replace(even, residuals=residuals))[:2]
    assert first.stands_out and second.stands_out
    assert first.residual == second.residual == "ln_work"
    assert {first.group[:3], second.group[:3]} == {"0 d", "180"}


@pytest.mark.parametrize("metal", ["Al", "St"])
def test_real_pushes_at_speed_repeat_to_three_percent(metal):
    path = SHARED / "pushes_mit" / "prelim_al_st_blocks.npz"
    if not path.exists():
        pytest.skip("../shared/data/pushes_mit is not on this machine")
    values = [
        product_between_rests(
            PushesMitImporter().read(path, Namespace(push=f"{metal}_{k}")).streams
        )
        for k in range(1, 7)
    ]
    assert np.std(values, ddof=1) < 0.03 * np.mean(values)


def test_lost_poses_of_goal_pushes_are_left_out_and_told():
    path = SHARED / "goal_pushes_zhou2017" / "logs.npz"
    if not path.exists():
        pytest.skip("../shared/data/goal_pushes_zhou2017 is not on this machine")
    recording = GoalPushesZhou2017Importer().read(path, Namespace(log=3))
    link = recording.streams.links[0]
    assert list(recording.problems.values()) == [19]
    assert np.linalg.norm(link.pose[-1, :2] - [0.0, -0.3175]) < 0.01
    assert np.linalg.norm(link.pose[:, :2], axis=1).min() > 0.1
