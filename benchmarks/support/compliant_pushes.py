"""Pushes by a compliant arm without a force sensor: commanded and measured path of its tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.planar.streams import LinkStream
from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.pushed.bodies import Bodies
from tactile_dynamics_ros.synthetic.pushed.effects import Faults
from tactile_dynamics_ros.synthetic.pushed.pusher import Pushers
from tactile_dynamics_ros.synthetic.pushed.recordings import PushOptions, draw_scene
from tactile_dynamics_ros.synthetic.pushed.scene import STEP, Scene
from tactile_dynamics_ros.synthetic.pushed.sensors import read_sensors
from tactile_dynamics_ros.synthetic.pushed.simulator import Motion, Simulation

_EVERY = 5
"""Steps of the physical clock from one pose of the tip to the next: 100 Hz."""
_JUMP = 0.01
"""m between samples, which no arm makes: simulated tips jump from action to action."""
_AROUND = 8
"""Samples around a jump that are left out: smoothing at 30 ms reaches as far."""
_NOISE = 2e-4
"""m, of measured places of the tip: of encoders and kinematics of collaborative arms."""


@dataclass(frozen=True)
class Arms:
    """Arms that are pulled to their commanded places; one for each scene.

    Attributes:
        stiffness: (B,) N/m. mass: (B,) kg, as the tip feels it. damping: (B,) N s/m.
        of_error: (B,) 1 where speeds are damped against the commanded one, 0 against rest.
        late: (B,) steps that commands come late. zero: (B, 2) N, of the balance. rub: (B,) N.
    """

    stiffness: np.ndarray
    mass: np.ndarray
    damping: np.ndarray
    of_error: np.ndarray
    late: np.ndarray
    zero: np.ndarray
    rub: np.ndarray


def draw_arms(seeds: Sequence[int], stated: float, std: float) -> Arms:
    """Arms whose stiffness is stated with a relative std."""
    drawn = []
    for seed in seeds:
        rng = randomness.stream(seed, "compliant arm")
        stiffness, mass = stated * float(np.exp(std * rng.normal())), float(rng.uniform(1.5, 4.0))
        damping = float(rng.uniform(0.6, 1.0)) * 2.0 * np.sqrt(stiffness * mass)
        of_error, late = float(rng.random() < 0.5), int(rng.integers(0, 6))
        zero, rub = 0.3 * rng.normal(size=2), 0.2 * rng.random()
        drawn.append((stiffness, mass, damping, of_error, late, zero, rub))
    return Arms(*(np.array(column) for column in zip(*drawn, strict=True)))


class CompliantPushers(Pushers):
    """Tips that follow their paths as an arm lets them.

    Attributes:
        commanded: (B, 2) m by step.
    """

    def __init__(self, scenes: Sequence[Scene], step: float, arms: Arms) -> None:
        super().__init__(scenes, step)
        self._arms, count = arms, len(scenes)
        self._at, self._speed, self._felt = (np.zeros((count, d)) for d in (3, 2, 2))
        self._first = np.zeros(count, dtype=int)
        self._poses: dict[int, np.ndarray] = {}
        self.commanded: list[np.ndarray] = []

    def begin(self, k: int, bodies: Bodies) -> None:
        """Place the pushers whose next action begins, at rest, and let all arms follow a step."""
        super().begin(k, bodies)
        for b, _ in self._starts.get(k, ()):
            self._at[b], self._speed[b] = super()._pose(k)[b], 0.0
            self._felt[b], self._first[b] = 0.0, k
        before = self._at.copy()
        self._follow(k)
        self._poses = {k: before, k + 1: self._at.copy()}
        self.commanded.append(super()._pose(k + 1)[:, :2])

    def _wanted(self, k: np.ndarray) -> np.ndarray:
        """Places (B, 2) of the paths at steps (B,), of the action that is made."""
        steps = np.maximum(k, self._first)
        found = np.zeros((len(steps), 2))
        for step in set(steps.tolist()):
            found[steps == step] = super()._pose(step)[steps == step, :2]
        return found

    def _follow(self, k: int) -> None:
        arms, step = self._arms, k + 1 - self._arms.late
        wanted = self._wanted(step)
        moving = (wanted - self._wanted(step - 1)) / self._h
        against = self._speed - arms.of_error[:, None] * moving
        force = arms.stiffness[:, None] * (wanted - self._at[:, :2]) + arms.zero
        force -= arms.damping[:, None] * against + self._felt
        size = np.maximum(np.linalg.norm(self._speed, axis=1), 5e-3)
        force -= (arms.rub / size)[:, None] * self._speed
        self._speed = self._speed + self._h * force / arms.mass[:, None]
        self._at[:, :2] += self._h * self._speed

    def _pose(self, k: int) -> np.ndarray:
        return self._poses[k]

    def record(self, k: int, *found: np.ndarray) -> tuple[np.ndarray, ...]:
        """Keep what the tips felt, for the arms."""
        columns = super().record(k, *found)
        self._felt = self._force.sum(axis=1)
        return columns


@dataclass(frozen=True)
class Compliant:
    """Paths of one recording, and the truth.

    Attributes:
        link: poses of the object. time: (K,) s of the tip. place, target: (K, 3) m, its middle.
        truth: of the object: mass, kg, friction_force_n, com.
    """

    link: LinkStream
    time: np.ndarray
    place: np.ndarray
    target: np.ndarray
    truth: dict[str, Any]


def push_compliantly(seeds: Sequence[int], options: PushOptions, arms: Arms) -> list[Compliant]:
    """Recordings of arms that push objects drawn by seeds."""
    scenes = [draw_scene(seed, options) for seed in seeds]
    simulation = Simulation(scenes)
    simulation.pushers = pushers = CompliantPushers(scenes, STEP, arms)
    motions = simulation.run()
    commanded = np.stack(pushers.commanded, axis=1)
    return [
        _recorded(scene, motion, target, options)
        for scene, motion, target in zip(scenes, motions, commanded, strict=True)
    ]


def _recorded(scene: Scene, motion: Motion, target: np.ndarray, options: PushOptions) -> Compliant:
    rng = randomness.stream(scene.seed, "compliant noise")
    link = read_sensors(motion, scene, Faults(), options.sensors, rng).links[0]
    ticks = np.arange(_EVERY, len(motion.time) - 1, _EVERY)
    jumps = np.linalg.norm(np.diff(motion.pusher[ticks, :2], axis=0), axis=1) > _JUMP
    near = np.convolve(np.append(False, jumps), np.ones(2 * _AROUND + 1), mode="same") > 0.0
    ticks = ticks[~near]
    height = np.full((len(ticks), 1), scene.tip.height)
    seen = motion.pusher[ticks, :2] + _NOISE * rng.normal(size=(len(ticks), 2))
    own = scene.thing.links[0]
    truth = {
        "mass": own.mass,
        "friction_force_n": own.mass * own.friction * 9.81,
        "com": own.com,
        "speed": max(action.speed for action in scene.actions),
    }
    return Compliant(
        link,
        motion.time[ticks],
        np.hstack([seen, height]),
        np.hstack([target[ticks], height]),
        truth,
    )
