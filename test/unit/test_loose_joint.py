"""Two parts on a joint whose pin is thinner than its hole: made by pushes, and told from them."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.linked.chances import Chances
from tactile_dynamics_ros.core.planar.linked.outlines import RelativePoses
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.core.planar.properties.linked_pair import Pair
from tactile_dynamics_ros.core.planar.properties.linked_structure import infer_structure
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions

TWO = ActionOptions(count=2, speed=(0.15, 0.25), travel=0.05)
JOINTED = pushed.PushOptions(kind="jointed", actions=TWO)
JOINT = np.array([0.05, 0.01])
BETWEEN = np.array([[0.05, 0.0], [-0.05, 0.0]])


@pytest.fixture(scope="module")
def made():
    """Two pushes with twice the usual play."""
    return pushed.generate([107], {"loose_joint": 2.0}, JOINTED)[0]


def _apart(made):
    """Where the hinge of the second part is beside that of the first, (K, 2) m."""
    thing, motion = made.scene.thing, made.motion

    def place(k, point):
        c, s = np.cos(motion.angle[:, k]), np.sin(motion.angle[:, k])
        turned = np.stack([c * point[0] - s * point[1], s * point[0] + c * point[1]], axis=1)
        return motion.origin[:, k] + turned

    return place(1, thing.joint - thing.offset) - place(0, thing.joint)


def test_a_pin_stays_in_its_hole_and_meets_the_wall(made):
    away = np.linalg.norm(_apart(made), axis=1)
    assert made.truth()["effects"]["loose_joint"]["parameters"]["play"] == pytest.approx(0.004)
    assert 3.9e-3 < away.max() < 4.2e-3
    assert away[0] < 1e-4
    tight = pushed.generate([107], {}, JOINTED)[0]
    assert np.abs(_apart(tight)).max() < 1e-9
    assert made.motion.lost[-1] <= made.motion.work[-1]


def test_only_two_parts_on_a_hinge_have_one():
    with pytest.raises(KeyError, match="loose_joint"):
        pushed.generate([3], {"loose_joint": 1.0}, pushed.PushOptions(actions=TWO))
    single = pushed.generate([3], {}, pushed.PushOptions(actions=TWO))[0]
    with pytest.raises(BadInputError, match="two parts"):
        estimate(single.streams, ["loose_joint"])
    assert PUSHED.create("loose_joint").of_joint


def test_a_diagnosis_asks_for_the_play_that_the_motion_shows(made):
    with pytest.raises(NotIdentifiableError, match="play .* loose_joint"):
        PushDiscrepancy.of_streams(made.streams)


def _poses(play, turn, random, count=80):
    """Relative poses of parts that turn by an angle, with a pin that jumps from wall to wall."""
    angle = turn * np.sin(np.linspace(0.0, 6.0, count))
    way = np.repeat(random.uniform(0.0, 2.0 * np.pi, 8), count // 8)
    slack = play * np.stack([np.cos(way), np.sin(way)], axis=1)
    arm = np.array([-0.05, -0.01])
    c, s = np.cos(angle), np.sin(angle)
    turned = np.stack([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]], axis=1)
    value = np.column_stack([JOINT - turned + slack, angle])
    std = np.array([2e-4, 2e-4, 2e-3])
    value = value + std * random.normal(size=value.shape)
    covariance = np.tile(np.diag(std**2), (count, 1, 1))
    share = np.full(count - 1, 1.0 / (count - 1))
    return RelativePoses(np.arange(count) * 0.05, value, covariance, 1.0, share)


CHANCES = Chances(np.full(3, 1.0 / 3.0), 0.05, 0.05)


def test_play_is_told_and_the_joint_is_found_where_it_is():
    random = np.random.default_rng(5)
    poses = _poses(0.002, 0.3, random)
    plain = infer_structure(poses, BETWEEN, 0.2, CHANCES)
    assert plain.name != "separate"
    assert plain.slack is not None
    loose = infer_structure(poses, BETWEEN, 0.2, CHANCES, loose=True)
    assert loose.name == "jointed"
    play, std = loose.hinge.play
    assert abs(play - 0.002) < 2.0 * std < 0.003
    assert np.linalg.norm(loose.hinge.first - JOINT) < 3e-3


def test_a_tight_joint_has_no_play_and_parts_that_drift_apart_no_joint():
    random = np.random.default_rng(6)
    tight = infer_structure(_poses(0.0, 0.3, random), BETWEEN, 0.2, CHANCES)
    assert tight.name == "jointed"
    assert tight.slack is None
    assert tight.hinge.play == (0.0, 0.0)
    apart = _poses(0.0, 0.3, random)
    apart.value[:, 1] += np.linspace(0.0, 0.06, len(apart.value))
    apart = infer_structure(apart, BETWEEN, 0.2, CHANCES)
    assert apart.name == "separate"
    assert apart.slack is None


def test_play_that_the_model_lacks_leaves_the_parts_open(made):
    found = estimate(made.streams)
    assert found.structure in ("jointed", "undecided")
    assert "estimate --effects loose_joint" in found.remedies[0]
    assert {"link_1.friction_force_n", "link_2.friction_force_n"} <= set(found.undetermined)
    assert found.to_document()["effects"] == {}
    play, std = Pair.of_streams(made.streams, loose=True).structure.hinge.play
    assert abs(play - 0.004) < 3.0 * std
