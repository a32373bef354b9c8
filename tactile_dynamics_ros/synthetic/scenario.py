"""One object, its motion and its grasp, evaluated on a fine physical clock."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.grasp import (
    FINGERS,
    ContactSamples,
    Grasp,
    Lift,
    draw_grasp,
    friction_margin,
    solve_contact_forces,
)
from tactile_dynamics_ros.synthetic.motion import CENTRE_W, Motion, MotionSamples, SumOfSines
from tactile_dynamics_ros.synthetic.objects import HeldObject, draw_object

GRAVITY = np.array([0.0, 0.0, -9.81])
_MAXIMAL_GRIP_N = 15.0


@dataclass(frozen=True)
class ScenarioOptions:
    """What kind of recording is drawn.

    Attributes:
        duration: s.
        physics_rate_hz: instants at which the truth is known; sensors sample some of them.
        band_hz: lowest and highest frequency of the motion.
        position_peak: (lowest, highest) peak excursion per axis, m.
        angle_peak_deg: (lowest, highest) peak rotation per axis.
        finger_roll: fingers turn about the contact normals, or keep their attitude to the object.
        regrasp: index, middle and ring move to new places around half-time.
        contact_breaks: how many times some finger loses contact and comes back.
        thumb_moves: the thumb moves in a re-grasp too; until it lands the others hold the object
            as if they stuck to it.
    """

    duration: float = 30.0
    physics_rate_hz: float = 1000.0
    band_hz: tuple[float, float] = (0.2, 2.0)
    position_peak: tuple[float, float] = (0.03, 0.10)
    angle_peak_deg: tuple[float, float] = (20.0, 60.0)
    finger_roll: bool = True
    regrasp: bool = False
    contact_breaks: int = 0
    thumb_moves: bool = False


class MovesObject(Protocol):
    """A motion about a mean pose."""

    @property
    def centre(self) -> np.ndarray:
        """(3,) m."""

    @property
    def mean_rotation(self) -> np.ndarray:
        """(3, 3)."""

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Motion with exact derivatives."""


@dataclass(frozen=True)
class Scene:
    """What effects may see: body, motion and contacts at N instants of the physical clock."""

    body: HeldObject
    motion: MotionSamples
    contacts: ContactSamples
    gravity: np.ndarray = field(default_factory=lambda: GRAVITY)

    @property
    def time(self) -> np.ndarray:
        """(N,) s."""
        return self.motion.time


@dataclass(frozen=True)
class Truth:
    """What happens physically at N instants.

    Attributes:
        scene: body, motion and contacts.
        hidden_wrench: (N, 6) torque about the origin and force of all hidden effects, world axes.
        contact_force: (N, C, 3) on the object, body axes.
        contact_torque: (N, C, 3) on the object about the contact point, body axes.
    """

    scene: Scene
    hidden_wrench: np.ndarray
    contact_force: np.ndarray
    contact_torque: np.ndarray

    def imbalance(self) -> np.ndarray:
        """(N, 6) contacts + hidden effects - inertia, body axes: zero by Newton and Euler."""
        scene = self.scene
        torque = np.cross(scene.contacts.point, self.contact_force) + self.contact_torque
        applied = np.concatenate([torque.sum(1), self.contact_force.sum(1)], axis=1)
        inertial = scene.body.inertial_wrench(scene.motion, scene.gravity)
        return applied + _wrench_to_body(scene.motion, self.hidden_wrench - inertial)


@dataclass(frozen=True)
class Scenario:
    """A held object, how it moves and how it is held."""

    seed: int
    options: ScenarioOptions
    body: HeldObject
    motion: MovesObject
    grasp: Grasp

    @classmethod
    def draw(cls, seed: int, options: ScenarioOptions | None = None) -> Scenario:
        """Draw everything from the seed; the grip is just strong enough for the motion."""
        options = options or ScenarioOptions()
        motion = _draw_motion(randomness.stream(seed, "motion"), options)
        return cls._held(seed, options, motion)

    def moved(self, motion: MovesObject, options: ScenarioOptions) -> Scenario:
        """The same object in the same hand along another motion."""
        return self._held(self.seed, options, motion)

    @classmethod
    def _held(cls, seed: int, options: ScenarioOptions, motion: MovesObject) -> Scenario:
        body = draw_object(randomness.stream(seed, "object"))
        lifts = _draw_lifts(randomness.stream(seed, "lifts"), options)
        grasp = draw_grasp(randomness.stream(seed, "grasp"), body, lifts)
        if not options.finger_roll:
            grasp = dataclasses.replace(grasp, roll=grasp.roll.scaled(0.0))
        loose = cls(seed, options, body, motion, grasp)
        return dataclasses.replace(loose, grasp=loose._tightened())

    def clock(self, stride: int = 1) -> np.ndarray:
        """Instants of the physical clock, every stride-th of them."""
        rate = self.options.physics_rate_hz
        return np.arange(0, round(self.options.duration * rate), stride) / rate

    def scene(self, time: np.ndarray) -> Scene:
        """Evaluate body, motion and contacts."""
        return Scene(self.body, self.motion.evaluate(time), self.grasp.evaluate(time))

    def simulate(self, effects: tuple = (), stride: int = 1) -> Truth:
        """Solve for the contact forces that move the object as prescribed despite the effects."""
        scene = self.scene(self.clock(stride))
        hidden = np.zeros((len(scene.time), 6))
        torque_map = np.zeros((*scene.contacts.weight.shape, 3, 3))
        for effect in effects:
            hidden = hidden + effect.wrench(scene)
            torque_map = torque_map + effect.contact_torque(scene)
        inertial = self.body.inertial_wrench(scene.motion, scene.gravity)
        wanted = _wrench_to_body(scene.motion, inertial - hidden)
        force = solve_contact_forces(scene.contacts, wanted, torque_map)
        return Truth(scene, hidden, force, np.einsum("ncij,ncj->nci", torque_map, force))

    def _tightened(self) -> Grasp:
        scene = self.scene(np.arange(0.0, self.options.duration, 0.05))
        inertial = self.body.inertial_wrench(scene.motion, scene.gravity)
        wanted = _wrench_to_body(scene.motion, inertial)
        for grip in np.geomspace(0.8, _MAXIMAL_GRIP_N, 16):
            grasp = dataclasses.replace(self.grasp, grip=float(grip))
            contacts = grasp.evaluate(scene.time)
            margin = friction_margin(contacts, solve_contact_forces(contacts, wanted))
            if np.mean(margin[contacts.weight.min(axis=1) == 1.0] < 0) < 0.01:
                break
        return grasp


def _wrench_to_body(motion: MotionSamples, wrench: np.ndarray) -> np.ndarray:
    return np.concatenate([motion.to_body(wrench[:, :3]), motion.to_body(wrench[:, 3:])], axis=1)


def _draw_motion(rng: np.random.Generator, options: ScenarioOptions) -> Motion:
    angles = np.radians(rng.uniform(*options.angle_peak_deg, size=3))
    mean = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return Motion(
        centre=CENTRE_W + rng.uniform(-0.05, 0.05, size=3),
        mean_rotation=mean * np.sign(np.linalg.det(mean)),
        position=SumOfSines.draw(rng, rng.uniform(*options.position_peak, size=3), options.band_hz),
        angles=SumOfSines.draw(rng, angles, options.band_hz),
    )


def _draw_lifts(rng: np.random.Generator, options: ScenarioOptions) -> tuple[Lift, ...]:
    lifts = []
    if options.regrasp:
        moving = 4 if options.thumb_moves else 3
        start = 0.5 * options.duration - 0.4 * moving
        for order, finger in enumerate(rng.permutation(moving)):
            begin = start + 0.9 * order
            lifts.append(Lift(int(finger), begin, begin + 0.7, moves=True))
    for _ in range(options.contact_breaks):
        begin = rng.uniform(0.05, 0.9) * options.duration
        clear = all(abs(begin - other.start) > 1.8 for other in lifts)
        if clear:
            lifts.append(Lift(int(rng.integers(3)), begin, begin + rng.uniform(0.5, 1.0), False))
    return tuple(lifts)


__all__ = ["FINGERS", "GRAVITY", "Scenario", "ScenarioOptions", "Scene", "Truth"]
