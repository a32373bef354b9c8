"""The dual filter of pushed objects: its algebra, the patch process, and a push step by step."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter import belief, dual
from tactile_dynamics_ros.core.planar.filter.belief import (
    joined,
    root_of,
    slope_of,
    unit_points,
    unlearnt,
    weighted_moments,
)
from tactile_dynamics_ros.core.planar.filter.linked_patch import LinkedPatchProcess
from tactile_dynamics_ros.core.planar.filter.observation import (
    MeasuredWrench,
    Observation,
    SeenPose,
)
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import Prediction, PusherMotion
from tactile_dynamics_ros.core.planar.filter.tracker import ContactForce, PushTracker
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions

BLOCK = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])
KNOWN = np.array([np.log(0.3), 0.0, 0.0, 0.0, np.log(0.4)])
"""0.3 kg of product, 1 kg, centred."""


@dataclass(frozen=True)
class Linear:
    """States that follow the first parameters, and a wrench that is linear in both."""

    least: float = -np.inf
    links: int = 1
    force_std: float = 0.0
    state_std: object = 0.0
    lasting: float = 1.0
    names: tuple[str, ...] = ("ln_product", "ln_mass", "com_x", "com_y")
    by_own = np.array([[0.3, 0.0, 0.1, 0.0], [0.0, 0.2, 0.0, 0.4], [0.0, 0.0, 0.0, 0.0]])

    @property
    def prior(self):
        """Mean and a covariance with a correlation."""
        root = np.diag([0.5, 0.3, 0.2, 0.4])
        root[1, 0] = 0.2
        return np.array([0.1, -0.2, 0.0, 0.1]), root @ root.T

    def feasible(self, parameters):
        """Centres on one side only."""
        return parameters[:, 2] > self.least

    def acting(self, states, parameters):
        """One by one; only inertia tells the mass."""
        return parameters, (1,)

    def predict(self, states, parameters, motion):
        """Velocities become those of parameters and half of their own."""
        moved = states.copy()
        moved[:, :3] += motion.step * states[:, 3:]
        moved[:, 3:] = 0.5 * states[:, 3:] + parameters @ self.by_own.T
        measured = (parameters @ self.by_own.T + 0.7 * states[:, 3:])[:, :3]
        return Prediction(moved, measured, self.force_std, self.state_std, self.lasting)


GOING = PusherMotion(np.zeros(3), np.array([1e-4, 0.0, 0.0]), 0.01, touching=True)


def linear_filter(process, **config):
    settings = dual.DualConfig(**{"variation": 1e-6, "hypotheses": 1000, **config})
    return dual.DualFilter(process, np.zeros(3), np.array([1e-3, 2e-3, 0.01]), settings)


def test_points_have_exactly_the_moments_of_the_belief():
    points = unit_points(60, 7, np.random.default_rng(0))
    assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
    assert_allclose(points.T @ points / 60, np.eye(7), atol=1e-12)


def test_a_joint_is_rebuilt_from_marginal_and_conditional():
    rng = np.random.default_rng(1)
    covariance = root_of(rng.normal(size=(9, 5)))
    own, slope = covariance[:2, :2], slope_of(covariance[2:, :2], covariance[:2, :2])
    belief = joined((np.zeros(2), own), slope, (np.zeros(3), covariance[2:, 2:]))
    assert_allclose(belief.covariance, covariance @ covariance.T, atol=1e-12)


def test_weighted_moments_keep_the_spread_of_all_that_counts_alike():
    points = unit_points(60, 3, np.random.default_rng(2)) * [0.1, 2.0, 5.0] + 1.0
    mean, root = weighted_moments(points, np.full(60, 1.0 / 60.0))
    assert_allclose(mean, 1.0, atol=1e-12)
    assert_allclose(root @ root.T, np.diag([0.01, 4.0, 25.0]), atol=1e-9)


def test_a_measurement_beyond_what_hypotheses_can_say_is_left_out_in_part():
    spread = np.linspace(-1.0, 1.0, 60)
    weights, kept = belief.tempered_weights(-0.5 * (spread / 1e-3) ** 2)
    assert 1.0 / np.sum(weights**2) == pytest.approx(30.0, rel=0.02)
    assert kept < 1e-3
    assert belief.tempered_weights(-0.5 * spread**2)[1] == 1.0


def test_both_steps_together_are_the_exact_update_of_a_linear_model(monkeypatch):
    monkeypatch.setattr(belief, "_TRUST", 1.0)
    process = Linear()
    found = linear_filter(process)
    mean, covariance = found.belief.mean.copy(), found.belief.covariance
    seen = Observation(
        (SeenPose(np.array([2e-4, 1e-3, 0.0]), np.array([1e-3, 1e-3, 5e-3]), 0.004),),
        MeasuredWrench(np.array([0.05, 0.02, 0.01]), np.array([0.3, 0.2, 0.5])),
    )
    found.step(GOING, seen)
    by = np.zeros((13, 13))
    by[:4, :4], by[10:, 10:] = np.eye(4), np.eye(3)
    by[4:7, 4:7], by[4:7, 7:10], by[7:10, 7:10] = np.eye(3), 0.01 * np.eye(3), 0.5 * np.eye(3)
    by[7:10, :4] = process.by_own
    noise = np.zeros((13, 13))
    noise[4:10, 4:10] = np.diag(np.square(dual._NOISE))
    by_seen = np.zeros((6, 13))
    by_seen[:3, 4:7], by_seen[:3, 7:10] = np.eye(3), -0.004 * np.eye(3)
    measured = np.zeros((3, 13))
    measured[:, :4], measured[:, 7:10] = process.by_own, 0.7 * np.eye(3)
    rows = np.concatenate([by_seen[:3] @ by, measured])
    extra = by_seen @ noise @ by_seen.T
    total = rows @ covariance @ rows.T + extra + np.diag(seen.noise() ** 2)
    cross = by @ covariance @ rows.T + noise @ by_seen.T
    gain = cross @ np.linalg.inv(total)
    expected = by @ mean + gain @ (seen.value - rows @ mean)
    spread = by @ covariance @ by.T + noise - gain @ total @ gain.T
    std = np.sqrt(np.diag(spread))[:10]
    assert_allclose(found.belief.mean[:10], expected[:10], atol=0.12 * std.max())
    assert np.all(np.abs(found.belief.mean[:10] - expected[:10]) < 0.12 * std)
    assert_allclose(found.belief.std[:10], std, rtol=0.1)


def test_what_a_model_says_of_its_own_forces_counts_as_their_noise():
    measured = Observation((), MeasuredWrench(np.array([0.05, 0.02]), np.array([0.3, 0.2])))
    stated = replace(
        measured, wrench=replace(measured.wrench, std=np.hypot(measured.wrench.std, 0.4))
    )
    own, told = linear_filter(Linear(force_std=0.4)), linear_filter(Linear())
    own.step(GOING, measured)
    told.step(GOING, stated)
    assert_allclose(own.belief.mean, told.belief.mean, atol=1e-9)
    assert_allclose(own.belief.std, told.belief.std, rtol=1e-6)


def test_what_a_model_says_of_its_own_states_spreads_them():
    stated = np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0])
    plain, spread = linear_filter(Linear()), linear_filter(Linear(state_std=stated))
    for each in (plain, spread):
        each.step(GOING, Observation())
    added = np.diag(spread.state[1]) - np.diag(plain.state[1])
    assert_allclose(added, stated**2, rtol=1e-6)


def test_what_is_not_learnt_follows_from_the_rest_as_before():
    rng = np.random.default_rng(9)
    before = unit_points(60, 4, rng) @ rng.normal(size=(4, 4)) + 1.0
    old = np.cov(before.T, bias=True)
    same = unlearnt((before.mean(axis=0), np.linalg.cholesky(old)), before, [1])
    assert_allclose(same[0], before.mean(axis=0), atol=1e-9)
    assert_allclose(same[1] @ same[1].T, old, atol=1e-9)
    seen = np.array([0.4, 7.0, -0.2, 1.0]), np.diag([0.1, 1e-6, 0.2, 0.3])
    mean, root = unlearnt(seen, before, [1])
    rest = [0, 2, 3]
    gain = np.linalg.solve(old[np.ix_(rest, rest)], old[rest, 1])
    spread, free = root @ root.T, old[1, 1] - gain @ old[rest, 1]
    assert_allclose(mean[1], 1.0 + gain @ (mean[rest] - 1.0))
    assert_allclose(spread[np.ix_(rest, rest)], np.diag([0.01, 0.04, 0.09]), atol=1e-12)
    kept = spread[1, 1] - spread[rest, 1] @ np.linalg.solve(
        np.diag([0.01, 0.04, 0.09]), spread[rest, 1]
    )
    assert_allclose(kept, free)


@pytest.mark.parametrize(("step", "learns"), [(0.01, True), (1.0 / 15.0, False)])
def test_a_coarse_step_tells_no_mass(step, learns):
    found = linear_filter(Linear())
    motion = replace(GOING, after=np.array([0.01 * step, 0.0, 0.0]), step=step)
    found.step(motion, Observation())
    mean, covariance = found.parameters
    found.step(motion, Observation((), MeasuredWrench(np.array([0.0, 3.0]), np.full(2, 0.01))))
    gain = np.linalg.solve(covariance[np.ix_([0, 2, 3], [0, 2, 3])], covariance[[0, 2, 3], 1])
    now, spread = found.parameters
    expected = mean[1] + gain @ (now - mean)[[0, 2, 3]]
    assert abs(now[1] - expected) > 0.01 if learns else abs(now[1] - expected) < 1e-9


FELT = Observation((), MeasuredWrench(np.array([1.0, 3.0]), np.full(2, 0.01)))


def test_a_tip_that_stands_or_starts_within_a_coarse_step_tells_no_force():
    coarse = replace(GOING, after=np.array([7e-4, 0.0, 0.0]), step=1.0 / 15.0)
    standing = replace(GOING, after=np.zeros(3))
    for motions, tells in (((standing,), False), ((coarse,), False), ((coarse, coarse), True)):
        found = linear_filter(Linear())
        for motion in motions[:-1]:
            found.step(motion, Observation())
        before = found.parameters[0]
        found.step(motions[-1], FELT)
        assert (np.abs(found.parameters[0] - before).max() > 0.05) == tells


@pytest.mark.parametrize(("slack", "tells"), [(5e-3, True), (2e-2, False)])
def test_a_tip_that_moves_by_no_more_than_it_may_give_way_tells_no_force(slack, tells):
    found = linear_filter(Linear())
    before = found.parameters[0]
    found.step(GOING, replace(FELT, slack=np.array([slack, 0.0])))
    assert (np.abs(found.parameters[0] - before).max() > 0.05) == tells


@dataclass(frozen=True)
class Growing(Linear):
    """Forces that grow with the exponential of a parameter, as friction does with ln product."""

    def predict(self, states, parameters, motion):
        """States stay."""
        force = np.zeros((len(states), 3))
        force[:, 0] = np.exp(parameters[:, 0])
        return Prediction(states.copy(), force, self.force_std, self.state_std)


def test_the_force_of_what_is_believed_teaches_nothing_however_unsure_the_belief():
    found = linear_filter(Growing())
    mean = found.parameters[0]
    measured = MeasuredWrench(np.array([np.exp(mean[0]), 0.0]), np.full(2, 0.05))
    found.step(GOING, Observation((), measured))
    assert_allclose(found.parameters[0], mean, atol=1e-3)
    assert found.parameters[1][0, 0] < 0.5 * Growing().prior[1][0, 0]


def test_parameters_that_a_measurement_does_not_tell_stay_as_they_are():
    rng, size = np.random.default_rng(3), 5
    mean, root, by_weights = np.zeros(size), np.eye(size), 0.0
    for _ in range(50):
        own = mean + unit_points(50, size, rng) @ root.T
        value = 0.1 * rng.normal(size=1)
        given = belief.Evidence(own, own, own[:, :1], value, 0.01 * np.eye(1), [])
        weighed = belief.learn_by_weights(given)[0][0] - own.mean(axis=0)
        by_weights = max(by_weights, np.abs(weighed[1:]).max())
        (mean, root), _ = belief.learn_by_trend(given)
    assert by_weights > 0.02
    assert_allclose(mean[1:], 0.0, atol=1e-9)
    assert_allclose((root @ root.T)[1:, 1:], np.eye(size - 1), atol=1e-9)
    assert (root @ root.T)[0, 0] == pytest.approx(1.0 / (1.0 + 50 * 0.2 / 0.01), rel=1e-6)


@pytest.mark.parametrize("learning_by", ["trend", "weights"])
def test_steps_of_a_model_whose_errors_last_longer_tell_so_much_less(learning_by):
    """Information of one step, of few hypotheses that differ by little."""
    told = []
    for lasting in (1.0, 4.0):
        found = linear_filter(Linear(lasting=lasting), learning=learning_by)
        seen = replace(FELT, wrench=replace(FELT.wrench, std=np.full(2, 10.0)))
        before = np.linalg.inv(found.parameters[1])
        found.step(GOING, seen)
        told.append(np.linalg.inv(found.parameters[1]) - before)
    rel = 1e-3 if learning_by == "trend" else 0.3
    assert told[0][0, 0] == pytest.approx(4.0 * told[1][0, 0], rel=rel)


def test_an_unknown_way_to_learn_is_refused():
    with pytest.raises(BadInputError, match="expected trend, weights, printed"):
        dual.DualConfig(learning="guess")


def test_impossible_hypotheses_are_kept_so_that_the_belief_does_not_shrink():
    free, bounded = linear_filter(Linear()), linear_filter(Linear(least=-0.1))
    for each in (free, bounded):
        each.step(GOING, Observation())
    assert_allclose(bounded.belief.std, free.belief.std, rtol=1e-6)
    unit = unit_points(60, 13, np.random.default_rng(4))
    assert 0.5 < np.mean(Linear(least=-0.1).feasible(free.belief.points(unit))) < 0.9


HALF = np.array([[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [-0.03, 0.03]])
PAIR = (PatchProcess(HALF, 0.02), PatchProcess(HALF, 0.02))
OWN = np.array([np.log(0.3), np.log(0.9), 0.0, 0.0, np.log(0.2), np.log(0.5), 0.0, 0.0, -1.0])


def pair_pushed(process, parameters, point, steps=40):
    """States and force after a push along y at 20 mm/s on a point of link_1."""
    states = np.zeros((1, 12))
    states[0, 6] = 0.06
    way = np.array([0.0, 2e-4, 0.0])
    for k in range(steps):
        at = np.array([*point, 0.0]) + k * way
        motion = PusherMotion(at, at + way, 0.01, 0.02, touching=True, normal=np.array([0.0, 1.0]))
        found = process.predict(states, parameters[None], motion)
        states = found.states
    return states[0], found.wrench[0]


def test_a_rigid_pair_that_is_pushed_at_its_middle_goes_straight_under_both_frictions():
    process = LinkedPatchProcess(PAIR, np.array([0.03, 0.0]), rigid=True)
    middle = 0.06 * 0.2 / 0.5  # where the friction of both balances
    states, wrench = pair_pushed(process, OWN, (middle, -0.03))
    assert_allclose(wrench[1], 0.5 * 9.81, rtol=0.01)
    assert_allclose(states[[2, 8]], 0.0, atol=2e-3)
    assert_allclose(states[[1, 7]], 0.008, atol=2e-4)
    assert_allclose(states[8] - states[2], 0.0, atol=1e-9)


def test_of_a_rigid_pair_only_the_whole_mass_and_centre_act_and_the_friction_of_each_face():
    process = LinkedPatchProcess(PAIR, np.array([0.03, 0.0]), rigid=True)
    other = OWN.copy()
    mass, friction = np.array([0.7, 0.7]), np.array([0.3 / 0.9, 0.2 / 0.5])
    other[[0, 4]], other[[1, 5]] = np.log(mass * friction), np.log(mass)
    other[6] = (0.5 * 0.06 / 0.7) - 0.06  # the common centre lies where it lay
    one, two = (pair_pushed(process, own, (0.01, -0.03)) for own in (OWN, other))
    assert_allclose(one[1][:2], two[1][:2], rtol=5e-3)  # inertia differs
    assert_allclose(one[0], two[0], rtol=0.04, atol=2e-4)
    assert abs(one[0][2]) > 0.01
    still = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.06, 0.0, 0.0, 0.0, 0.0, 0.0], (2, 1))
    acting, inertial = process.acting(still, np.stack([OWN, other]))
    assert_allclose(acting[0], acting[1], atol=1e-12)
    assert inertial == (5,)
    assert acting[0, 5] == pytest.approx(np.log(1.4))


def test_a_common_centre_tells_how_a_mass_is_shared_out_where_nothing_tells_the_mass():
    rng, aim = np.random.default_rng(5), np.array([0.7])
    mean, root = np.zeros(2), 0.5 * np.eye(2)
    for _ in range(60):
        own = mean + unit_points(50, 2, rng) @ root.T
        whole = np.logaddexp(own[:, :1], own[:, 1:])
        share = np.exp(own[:, 1:] - whole)
        given = belief.Evidence(own, np.hstack([share, whole]), share, aim, 1e-3 * np.eye(1), [1])
        (mean, root), _ = belief.learn_by_trend(given)
    covariance = root @ root.T
    across, along = np.array([-1.0, 1.0]), np.array([1.0, 1.0])
    assert across @ mean == pytest.approx(np.log(0.7 / 0.3), abs=0.15)
    assert across @ covariance @ across < 0.1
    assert abs(along @ mean) < 0.05
    assert along @ covariance @ along == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize("joint_friction", [1e-4, 0.5])
def test_a_joint_holds_its_links_together_and_turns_only_if_its_friction_lets_it(joint_friction):
    process = LinkedPatchProcess(PAIR, np.array([0.03, 0.0]))
    assert process.names[-1] == "ln_joint_friction"
    states, _ = pair_pushed(process, np.append(OWN, np.log(joint_friction)), (0.0, -0.03))
    ends = [
        states[6 * k : 6 * k + 2] + (0.03 - 0.06 * k) * np.array([np.cos(yaw), np.sin(yaw)])
        for k, yaw in enumerate(states[[2, 8]])
    ]
    assert_allclose(ends[0], ends[1], atol=1e-9)
    turned = abs(states[8] - states[2])
    assert turned < 1e-3 if joint_friction == 0.5 else turned > 0.02


def test_the_mechanics_of_one_link_are_those_of_a_patch():
    one, linked = PatchProcess(BLOCK), LinkedPatchProcess((PatchProcess(BLOCK),))
    motion = PusherMotion(np.array([-0.05, 0.01, 0.0]), np.array([-0.049, 0.01, 0.0]), 0.05)
    mine, its = (p.predict(np.zeros((1, 6)), KNOWN[None], motion) for p in (linked, one))
    assert_allclose(mine.states, its.states)
    assert linked.names == one.names
    assert_allclose(linked.prior[1], one.prior[1])


def pushed_by(process, at, way, parameters, steps=60, **motion):
    """Push a block for a while; return the last prediction."""
    states = np.zeros((1, 6))
    for k in range(steps):
        before, after = (np.array([*at, 0.0]) + (k + i) * np.array([*way, 0.0]) for i in (0, 1))
        given = {"touching": True, "normal": np.array([1.0, 0.0]), **motion}
        found = process.predict(
            states, parameters[None], PusherMotion(before, after, 0.01, **given)
        )
        states = found.states
    return found


def test_a_steady_push_through_the_centre_takes_the_friction_force():
    found = pushed_by(PatchProcess(BLOCK), [-0.05, 0.0], [3e-4, 0.0], KNOWN)
    assert_allclose(found.wrench[0], [0.3 * 9.81, 0.0, 0.0], atol=1e-3)
    assert_allclose(found.states[0, 3:], [0.03, 0.0, 0.0], atol=1e-4)


def test_a_lift_takes_load_off_the_support():
    lifted = pushed_by(PatchProcess(BLOCK), [-0.05, 0.0], [3e-4, 0.0], KNOWN, lift=0.981)
    assert_allclose(lifted.wrench[0, 0], 0.9 * 0.3 * 9.81, rtol=1e-3)


def test_a_tip_that_slides_pushes_along_the_edge_of_its_cone():
    found = pushed_by(PatchProcess(BLOCK), [-0.05, 0.0], [1e-4, 3e-4], KNOWN, steps=8)
    assert found.wrench[0, 1] / found.wrench[0, 0] == pytest.approx(0.4, rel=1e-3)
    assert found.states[0, 3] == pytest.approx(0.01, rel=0.2)


def test_a_tip_that_slides_along_an_edge_takes_the_same_force_in_few_rounds_as_in_many():
    corners = np.array([[-0.036, -0.029], [0.071, -0.029], [-0.036, 0.057]])
    own = np.array([np.log(0.15), np.log(0.5), 0.0, 0.0, np.log(0.23)])
    inwards = -np.array([0.086, 0.107]) / np.hypot(0.086, 0.107)
    way = 7e-4 * inwards + 14e-4 * np.array([-inwards[1], inwards[0]])  # 12 and 22 mm/s
    forces = []
    for rounds in (4, 40):
        found = pushed_by(
            PatchProcess(corners, rounds=rounds), [0.025, 0.0087], way, own, 4, normal=inwards
        )
        forces.append(found.wrench[0, :2])
    assert_allclose(forces[0], forces[1], atol=0.02 * np.linalg.norm(forces[1]))


def test_without_touch_the_object_stops_as_friction_says():
    states = np.array([[0.0, 0.0, 0.0, 0.1, 0.0, 0.0]])
    away = PusherMotion(np.zeros(3), np.zeros(3), 0.01, touching=False)
    found = PatchProcess(BLOCK).predict(states, KNOWN[None], away)
    assert found.states[0, 3] == pytest.approx(0.1 - 0.01 * 0.3 * 9.81, rel=0.02)
    assert not found.wrench.any()


def test_where_nothing_is_felt_the_outline_decides():
    away = pushed_by(PatchProcess(BLOCK), [-0.07, 0.0], [3e-4, 0.0], KNOWN, 20, touching=None)
    assert not away.wrench.any()
    reached = pushed_by(PatchProcess(BLOCK), [-0.06, 0.0], [3e-4, 0.0], KNOWN, 60, touching=None)
    assert reached.wrench[0, 0] == pytest.approx(0.3 * 9.81, rel=0.01)


def test_a_grip_takes_the_object_along():
    found = PatchProcess(BLOCK).predict(
        np.zeros((1, 6)),
        KNOWN[None],
        PusherMotion(np.zeros(3), np.array([1e-4, 0.0, 2e-3]), 0.01, grip=True, touching=True),
    )
    assert_allclose(found.states[0, 3:], [0.01, 0.0, 0.2], atol=2e-3)


@pytest.fixture(scope="module")
def recording():
    """One object pushed once, with the truth."""
    actions = ActionOptions(count=1, speed=(0.08, 0.1), pauses=0)
    return pushed.generate([612], {}, pushed.PushOptions(actions=actions))[0]


def play(recording, drop=lambda kind, time: False, until=np.inf):
    """Feed a tracker as measurements would come."""
    link, contact = recording.streams.links[0], recording.streams.contacts["pusher"]
    motion, height = recording.motion, recording.truth()["push_height"]
    tracker = PushTracker(PatchProcess(link.footprint))
    rows = [(t, "pose", k) for k, t in enumerate(link.time)]
    rows += [(t, "force", k) for k, t in enumerate(contact.time)]
    rows += [(t, "pusher", 0) for t in np.arange(motion.time[0], motion.time[-1], 0.01)]
    yaw = np.unwrap(motion.pusher[:, 2])
    columns = [motion.pusher[:, 0], motion.pusher[:, 1], np.full(len(yaw), height), yaw]
    for time, kind, k in sorted(rows):
        if drop(kind, time) or time > until:
            continue
        if kind == "pose":
            tracker.add_pose(time, link.pose[k], link.pose_std)
        elif kind == "pusher":
            place = [np.interp(time, motion.time, column) for column in columns]
            tracker.add_pusher(time, np.array(place))
        else:
            tracker.add_contact(
                ContactForce("pusher", time, contact.force[k], contact.force_std, contact.point[k],
                     contact.normal[k])
            )  # fmt: skip
        tracker.advance(time - 0.02)
    return tracker


def check_friction(tracker, recording):
    truth = recording.truth()["links"][0]
    mean, covariance = tracker.filter.parameters
    off = mean[0] - np.log(truth["mass"] * truth["friction"])
    std = np.sqrt(covariance[0, 0])
    assert std < 0.12
    assert abs(off) < 3.0 * std
    return std


def test_pushes_tell_the_friction_and_the_pose_is_followed(recording):
    tracker = play(recording)
    check_friction(tracker, recording)
    motion = recording.motion
    k = int(np.searchsorted(motion.time, tracker.time))
    state, covariance = tracker.filter.state
    truth = np.array([*motion.origin[k, 0], motion.angle[k, 0]])
    std = np.sqrt(np.diag(covariance))[:3]
    assert np.all(np.abs(state[:3] - truth) < 4.0 * std)
    assert std[0] < 2.5e-4  # poses of 0.5 mm, many


def test_messages_that_drop_out_cost_precision_only(recording):
    rng = np.random.default_rng(3)

    def drop(kind, time):
        return kind != "pusher" and (rng.uniform() < 0.3 or (kind == "pose" and 1.0 < time < 1.2))

    check_friction(play(recording, drop), recording)


def test_a_touch_without_the_pusher_is_counted_and_teaches_nothing(recording):
    tracker = play(recording, lambda kind, time: kind == "pusher", until=1.5)
    assert tracker.problems["pusher_missing"] > 10
    before = PatchProcess(recording.streams.links[0].footprint).prior
    assert_allclose(tracker.filter.parameters[1][:4, :4], before[1][:4, :4], atol=1e-9)


def test_the_printed_step_takes_the_belief_away():
    own = unit_points(50, 3, np.random.default_rng(1))
    given = belief.Evidence(own, own, own[:, :1], np.zeros(1), 1e6 * np.eye(1), [])
    for name, kept in (("weights", 1.0), ("printed", 0.98 * np.sqrt(1.0 - 0.98**2))):
        (_, root), _ = belief.LEARNINGS[name](given)
        assert_allclose(root @ root.T, kept**2 * np.eye(3), atol=1e-5)
