"""The generator of pushed recordings: its truth against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import Action
from tactile_dynamics_ros.synthetic.pushed.effects import hide
from tactile_dynamics_ros.synthetic.pushed.friction_field import spread_weight
from tactile_dynamics_ros.synthetic.pushed.objects import GRAVITY, draw_object
from tactile_dynamics_ros.synthetic.pushed.recordings import draw_scene
from tactile_dynamics_ros.synthetic.pushed.scene import STEP, Scene, Tip
from tactile_dynamics_ros.synthetic.pushed.simulator import Simulation, simulate

SHORT = pushed.PushOptions(actions=pushed.ActionOptions(count=1, travel=0.04, duration=0.6))


def _left_alone(thing, angle, steps=150) -> Scene:
    """An object on a leaning table that nobody touches."""
    nobody = Action(
        "none", 0, np.zeros(2), 0.0, np.array([1.0, 0.0]), 0.0, 0.0, np.zeros((steps, 3)), 0.0
    )
    gravity = GRAVITY * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    return Scene(0, thing, Tip(), (nobody,), gravity=gravity)


def test_an_object_slides_on_a_table_that_leans_more_than_its_friction_allows():
    thing = draw_object(4)
    critical = np.arctan(thing.links[0].friction)
    held, slid = simulate([_left_alone(thing, share * critical) for share in (0.97, 1.03)])
    assert np.linalg.norm(held.origin[-1, 0]) < 1e-5
    angle = 1.03 * critical
    excess = GRAVITY * (np.sin(angle) - thing.links[0].friction * np.cos(angle))
    assert slid.origin[-1, 0, 0] == pytest.approx(0.5 * excess * slid.time[-1] ** 2, rel=0.02)


def test_a_hinge_on_ice_turns_freely_until_its_friction_has_stopped_it():
    thing = draw_object(2, "jointed")
    ice = tuple(replace(link, friction=0.0) for link in thing.links)
    thing = replace(thing, links=ice, joint_friction=1e-3)
    simulation = Simulation([_left_alone(thing, 0.0)])
    bodies, spin = simulation.bodies, 2.0
    simulation._u[0] = [0.0, 0.0, 0.0, spin]
    bodies.turn_rate = simulation._u[:, 2:].copy()
    G = bodies.velocities(bodies.com[:, :, None])[:, :, 0]
    bodies.com_velocity = np.einsum("blkd,bd->blk", G, simulation._u)
    before = float(bodies.kinetic_energy()[0])
    momentum = np.einsum("bl,blk->k", bodies.mass, bodies.com_velocity)
    motion = simulation.run()[0]
    assert motion.kinetic[-1] + motion.lost[-1] == pytest.approx(before, rel=0.02)
    np.testing.assert_allclose(
        np.einsum("bl,blk->k", bodies.mass, bodies.com_velocity), momentum, atol=1e-6
    )
    swept = np.abs(np.diff(np.diff(motion.angle, axis=1)[:, 0])).sum()
    assert motion.lost[-1] == pytest.approx(thing.joint_friction * swept, rel=0.03)


def test_the_feet_carry_the_weight_and_balance_the_moments():
    rng = np.random.default_rng(0)
    feet = rng.uniform(-0.05, 0.05, (1, 40, 2))
    stiffness = rng.uniform(0.5, 2.0, (1, 40))
    moment = np.array([[0.2, -0.15]])
    force, touching = spread_weight(
        feet, stiffness, np.array([10.0]), moment, np.ones((1, 40), dtype=bool)
    )
    assert force.min() >= 0.0
    assert 0 < np.sum(~touching) < 20
    assert force.sum() == pytest.approx(10.0, rel=1e-6)
    np.testing.assert_allclose((force[..., None] * feet).sum(axis=1), moment, rtol=1e-5)


def test_a_steady_push_through_the_centre_needs_the_friction_force():
    thing = draw_object(4)
    link = thing.links[0]
    scene = draw_scene(4, SHORT)
    action = scene.actions[0]
    middle = link.feet.mean(axis=0)
    centred = replace(link, com=middle)
    reach = float(link.corners[:, 0].min())
    action = replace(
        action,
        point=np.array([reach, middle[1]]),
        heading=0.0,
        normal=np.array([1.0, 0.0]),
    )
    scene = replace(scene, thing=replace(thing, links=(centred,)), actions=(action,))
    motion = simulate([scene])[0]
    speed = np.linalg.norm(np.gradient(motion.origin[:, 0], STEP, axis=0), axis=1)
    moving = speed > 0.9 * action.speed
    force = np.median(np.linalg.norm(motion.force[moving, 0], axis=1))
    assert force == pytest.approx(link.mass * link.friction * GRAVITY, rel=0.02)


def test_work_goes_into_friction_and_a_shorter_step_changes_little():
    scenes = [draw_scene(seed, SHORT) for seed in (1, 2, 3)]
    coarse = simulate(scenes)
    for motion in coarse:
        assert motion.lost[-1] <= motion.work[-1]
        assert motion.lost[-1] > 0.95 * motion.work[-1]
    twice = [
        replace(
            scene,
            actions=tuple(replace(a, path=_halved(a.path)) for a in scene.actions),
        )
        for scene in scenes
    ]
    for one, other in zip(coarse, simulate(twice, 0.5 * STEP), strict=True):
        assert np.linalg.norm(one.origin[-1] - other.origin[-1]) < 2e-4
        assert np.abs(one.angle[-1] - other.angle[-1]).max() < 3e-3


def _halved(path: np.ndarray) -> np.ndarray:
    before = np.concatenate([np.zeros((1, 3)), path])
    both = np.empty((2 * len(path), 3))
    both[0::2], both[1::2] = 0.5 * (before[1:] + before[:-1]), path
    return both


def test_every_effect_changes_the_motion_or_spoils_the_sensor():
    twice = replace(SHORT, actions=replace(SHORT.actions, count=2, speed=(0.1, 0.2)))
    clean = draw_scene(3, twice)
    names = [*pushed.CATALOGUE, *pushed.OUTSIDE]
    hidden = [hide(name, 1.5, clean, np.random.default_rng(5)) for name in names]
    before, *after = simulate([clean, *(h.scene for h in hidden)])
    for name, spoilt, motion in zip(names, hidden, after, strict=True):
        assert spoilt.parameters
        moved = np.linalg.norm(motion.origin[-1] - before.origin[-1])
        turned = np.abs(motion.angle[-1] - before.angle[-1]).max()
        if spoilt.faults is None:
            assert moved + 0.05 * turned > 3e-5, name
        else:
            assert moved == 0.0
            force, yaw = np.tile([3.0, 1.0, 0.0], (4, 1)), np.zeros(4)
            sent = spoilt.faults.applied(force, yaw)
            assert np.abs(sent - force).max() > 0.05 or abs(spoilt.faults.delay) > 0.01


def test_equal_seeds_give_equal_recordings_alone_or_among_others():
    alone = pushed.generate([7], {"force_bias": 1.0}, SHORT)[0]
    among = pushed.generate([8, 7], {"force_bias": 1.0}, SHORT)[1]
    assert alone.truth() == among.truth()
    one, other = alone.streams.contacts["pusher"], among.streams.contacts["pusher"]
    np.testing.assert_allclose(one.force, other.force, atol=1e-5)
