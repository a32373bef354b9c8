"""Two parts that are pushed: what they are to each other, where the joint is, what is not known."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.planar.linked.description import remedies
from tactile_dynamics_ros.core.planar.linked.outlines import (
    RelativePoses,
    meeting_points,
    room_to_turn,
)
from tactile_dynamics_ros.core.planar.linked.rows import PairPatch
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.core.planar.properties.latent_model import ELSEWHERE, Sharpness
from tactile_dynamics_ros.core.planar.properties.linked_estimate import (
    _of_jointed,
    _trusted,
    _undetermined,
)
from tactile_dynamics_ros.core.planar.properties.linked_fit import (
    _data,
    _place_std,
    fit_jointed,
)
from tactile_dynamics_ros.core.planar.properties.linked_jointed import JointedModel
from tactile_dynamics_ros.core.planar.properties.linked_pair import Pair
from tactile_dynamics_ros.core.planar.properties.linked_rigid import RigidModel
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions

ACTIONS = ActionOptions(count=2, speed=(0.1, 0.2), travel=0.06)
SQUARE = np.array([[-0.04, -0.04], [0.04, -0.04], [0.04, 0.04], [-0.04, 0.04]])


def _made(kind, seed):
    return pushed.generate([seed], {}, pushed.PushOptions(kind=kind, actions=ACTIONS))[0]


@pytest.fixture(scope="module")
def jointed():
    """Two pushes of two parts on a hinge that turns."""
    return _made("jointed", 107)


@pytest.fixture(scope="module")
def rigid():
    """Two pushes of two boxes that are glued together."""
    return _made("rigid_pair", 107)


@pytest.fixture(scope="module")
def pair(jointed):
    """The jointed parts as they were seen."""
    return Pair.of_streams(jointed.streams)


def test_a_joint_that_turns_is_found_where_it_is(pair, jointed):
    structure = pair.structure
    assert structure.name == "jointed"
    away = structure.hinge.first - jointed.truth()["joint"]["position"]
    assert np.linalg.norm(away) < 2e-3
    std = np.sqrt(np.diag(structure.hinge.covariance)[:2])
    assert np.all(np.abs(away) < 4.0 * std)


def test_a_pair_that_moves_as_one_body_is_never_called_jointed(rigid):
    structure = Pair.of_streams(rigid.streams).structure
    assert structure.name in ("rigid", "undecided")
    assert structure.probability["jointed"] < 0.1


def test_a_part_that_stays_behind_is_separate(rigid):
    first, second = rigid.streams.links
    still = replace(second, pose=np.tile(second.pose[:1], (len(second.time), 1)))
    rng = np.random.default_rng(0)
    still = replace(still, pose=still.pose + second.pose_std * rng.normal(size=still.pose.shape))
    left = Pair.of_streams(replace(rigid.streams, links=(first, still)))
    assert left.structure.name == "separate"


def test_loose_parts_that_turn_a_lot_are_not_jointed(jointed):
    first, second = jointed.streams.links
    slid = second.pose.copy()
    slid[:, 0] += np.linspace(0.0, 0.03, len(slid))
    loose = replace(jointed.streams, links=(first, replace(second, pose=slid)))
    assert Pair.of_streams(loose).structure.name == "separate"


def test_noise_that_is_stated_too_small_is_measured(rigid):
    first, second = rigid.streams.links
    small = replace(second, pose_std=0.2 * second.pose_std)
    poses = RelativePoses.of_links(replace(first, pose_std=0.2 * first.pose_std), small)
    assert poses.noise == pytest.approx(5.0, rel=0.2)


def test_flat_faces_leave_no_room_and_a_gap_between_round_parts_does():
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    disc = 0.04 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert room_to_turn(SQUARE, SQUARE, np.array([0.08, 0.0, 0.0])) < 0.2
    assert room_to_turn(disc, disc, np.array([0.084, 0.0, 0.0])) == 1.0
    between = meeting_points(disc, disc, np.array([0.084, 0.0, 0.3])).mean(axis=0)
    np.testing.assert_allclose(between, [0.042, 0.0], atol=1.5e-3)


def _slope_agrees(model, coordinates):
    rng = np.random.default_rng(1)
    nodes = np.column_stack([coordinates, np.zeros((len(coordinates), model.locals))])
    mean, std = model.prior
    common = mean + 0.05 * np.minimum(std, 1.0) * rng.normal(size=len(mean))
    around = rng.normal(size=nodes.shape) * model.node_scale
    across = 0.1 * rng.normal(size=len(mean)) * np.minimum(std, 1.0)
    sharp = Sharpness(5e-3, 3.0, 0.03)
    here = model.linearise(nodes, common, sharp)
    by_formula = 2.0 * (np.sum(here.gradient * around) + here.common_gradient @ across)
    step = 1e-5
    ahead, behind = (
        model.linearise(nodes + k * around, common + k * across, sharp).cost for k in (step, -step)
    )
    assert (ahead - behind) / (2.0 * step) == pytest.approx(by_formula, rel=2e-3)


def test_gradients_of_both_structures_are_derivatives(pair):
    spread = np.column_stack([pair.spread[0], pair.spread[1][:, 2]])
    coordinates = np.column_stack([pair.nodes[0], pair.nodes[1][:, 2]])
    _slope_agrees(JointedModel(_data(pair, spread), hinge=pair.structure.hinge), coordinates)
    placed = pair.outlines[1] + pair.relative.value[0][:2]
    patch = PairPatch(pair.outlines[0], other=placed)
    rigid = RigidModel(_data(pair, pair.spread[0]), patch, pair.relative.value[0])
    _slope_agrees(rigid, pair.nodes[0])


def test_friction_of_places_that_were_not_pushed_widens_the_table(pair, rigid):
    spread = np.column_stack([pair.spread[0], pair.spread[1][:, 2]])
    model = JointedModel(_data(pair, spread), hinge=pair.structure.hinge)
    nodes = np.zeros((len(pair.nodes[0]), 10))
    assert np.all(_place_std(model, nodes) == 0.0)
    nodes[:, 7], nodes[:, 8] = 0.05, 0.02
    std = dict(zip(model.names, _place_std(model, nodes), strict=True))
    size = np.sqrt(pair.patches[1].gyration)
    assert std.pop("ln_product_2") == pytest.approx(ELSEWHERE[0] * 0.05)
    assert std.pop("com_x_2") == pytest.approx(ELSEWHERE[1] * 0.02 * size)
    assert not any(std.values())
    other = Pair.of_streams(rigid.streams)
    patch = PairPatch(other.outlines[0], other=other.outlines[1] + other.relative.value[0][:2])
    whole = RigidModel(_data(other, other.spread[0]), patch, other.relative.value[0])
    nodes = np.full((len(other.nodes[0]), 6), 0.03)
    assert _place_std(whole, nodes)[whole.at("ln_product")] == pytest.approx(ELSEWHERE[0] * 0.03)


def test_what_one_body_hides_of_its_parts_is_said(rigid):
    found, truth = estimate(rigid.streams), rigid.truth()["links"]
    force, std = found.whole["friction_force_n"]
    whole = sum(link["friction_force_n"] for link in truth)
    assert abs(force - whole) < min(3.0 * std, 0.1 * whole)
    assert {"link_1.mass", "link_2.mass", "link_1.friction_force_n"} <= set(found.undetermined)
    for link, real in zip(found.links, truth, strict=True):
        assert abs(link["mass"][0] - real["mass"]) < 3.0 * link["mass"][1]
    assert "one by one" in "\n".join(found.lines())
    document = json.loads(json.dumps(found.to_document()))
    assert document["joint"]["probability"] < 0.2
    assert document["joint"]["position"] is None


def test_a_joint_may_carry_parts_so_that_pushes_tell_no_centre_of_mass(pair, jointed):
    fit = fit_jointed(pair)
    found = _of_jointed(pair, fit)
    undetermined = _undetermined(pair, found)
    for k, link in enumerate(found.links):
        assert f"link_{k + 1}.com" in undetermined
        own = jointed.truth()["links"][k]["com"]
        for axis, true in zip("xy", own, strict=True):
            carried, std = link[f"carried_{axis}"]
            assert abs(carried - true) < 4.0 * std  # here each part rests by itself
            assert link[f"com_{axis}"][1] > 0.4 * np.sqrt(pair.patches[k].gyration)
    assert any("lift the parts one by one" in said for said in remedies("jointed", False, ()))
    off = _trusted(replace(fit, whitened_rms=2.0))
    assert {"link_1.mass", "link_2.mass"} <= set(_undetermined(pair, _of_jointed(pair, off)))
    assert off.std("ln_product_1") == fit.std("ln_product_1")
