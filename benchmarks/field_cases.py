"""Tables as people record them: one load on a wrist force/torque sensor, and what they do wrong.

A balance of momentum in the axes of the world, by differences of a motion in closed form; it shares
nothing with the product.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import butter, lfilter
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.array import Array

RATE_HZ, SECONDS, ROWS = 100.0, 15.0, 24
"""Samples per second and length of a log, and poses of a table without time."""
FORCE_STD, TORQUE_STD, PLACE_STD, TURN_STD = 0.05, 4e-3, 2e-5, 2e-4
"""Noise, N, N m, m and rad: a good wrist sensor, and the encoders of an arm."""
ZERO = np.array([1.5, -2.2, 4.1, 0.05, -0.03, 0.02])
"""What a sensor reads with nothing on it, N and N m, if it was not zeroed."""
UP = np.array([0.0, 0.0, 9.81])
_STEP = 1e-3
"""Step of the differences, s: rounding and the fifth derivative both leave 1e-6 of them."""


@dataclass(frozen=True)
class Load:
    """What the sensor carries: mass, kg, centre, m, and inertia about it, kg m^2, sensor axes."""

    mass: float
    com: Array
    inertia: Array

    def scaled(self, mass: float) -> Load:
        """The same shape of another mass."""
        return Load(mass, self.com, self.inertia * mass / self.mass)


@dataclass(frozen=True)
class Log:
    """Columns of a table, before somebody does something wrong.

    Attributes:
        time: (N,) s; None for a table of static poses.
        place: (N, 3) m, world axes; turn: N rotations, sensor to world.
        wrench: (N, 6) N and N m of the load on the sensor, sensor axes, its zero included.
        load: in the first and, where it changes, the last part.
    """

    time: Array | None
    place: Array
    turn: Rotation
    wrench: Array
    load: tuple[Load, ...]


Corruption = Callable[[Log, np.random.Generator], Log]


def draw_load(random: np.random.Generator) -> Load:
    """A load of 0.5 to 1.5 kg whose centre is 5 to 9 cm in front of the sensor."""
    com = np.array([*random.uniform(-0.02, 0.02, 2), random.uniform(0.05, 0.09)])
    mass = float(random.uniform(0.5, 1.5))
    axes = Rotation.random(random_state=int(random.integers(2**31))).as_matrix()
    size = random.uniform(0.02, 0.05, 3) ** 2
    return Load(mass, com, mass * axes @ np.diag(size.sum() - size) @ axes.T)


class Motion:
    """Sums of sines of 0.1 to 0.9 Hz: place (m), and angles about z, y and x (rad)."""

    def __init__(self, random: np.random.Generator) -> None:
        self._rate = 2.0 * np.pi * random.uniform(0.1, 0.9, (6, 3))
        self._phase = random.uniform(0.0, 2.0 * np.pi, (6, 3))
        size = np.array([0.06, 0.06, 0.06, 0.5, 0.4, 0.5])[:, None]
        self._size = size * random.uniform(0.5, 1.0, (6, 3))
        self._middle = np.array([0.45, 0.0, 0.5, *random.uniform(-0.2, 0.2, 3)])

    def at(self, time: Array) -> tuple[Array, Rotation]:
        """Place (N, 3) and turns at times (N,)."""
        waves = np.sin(self._rate * time[:, None, None] + self._phase)
        values = self._middle + np.sum(self._size * waves, axis=2)
        return values[:, :3], Rotation.from_euler("ZYX", values[:, 3:])


def wrench_on_load(motion: Motion, load: Load, time: Array) -> Array:
    """(N, 6) force and torque about the sensor's origin, sensor axes, by the change of momentum."""

    def momentum(t: Array) -> tuple[Array, Array]:
        place, turn = motion.at(t)
        later, earlier = motion.at(t + _STEP), motion.at(t - _STEP)
        centre = [p + r.apply(load.com) for p, r in (later, earlier)]
        spin = (later[1] * earlier[1].inv()).as_rotvec() / (2.0 * _STEP)
        body = np.einsum("ij,nj->ni", load.inertia, turn.inv().apply(spin))
        return load.mass * (centre[0] - centre[1]) / (2.0 * _STEP), turn.apply(body)

    after, before = momentum(time + _STEP), momentum(time - _STEP)
    force, couple = ((a - b) / (2.0 * _STEP) for a, b in zip(after, before, strict=True))
    force = force + load.mass * UP
    turn = motion.at(time)[1]
    couple = couple + np.cross(turn.apply(load.com), force)
    return np.hstack([turn.inv().apply(force), turn.inv().apply(couple)])


def draw_log(seed: int, zero: Array = ZERO, seconds: float = SECONDS) -> Log:
    """A log of 15 s at 100 Hz of a drawn load."""
    random = np.random.default_rng([62, seed])
    load, motion = draw_load(random), Motion(random)
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    place, turn = motion.at(time)
    log = Log(time, place, turn, -wrench_on_load(motion, load, time) + zero, (load,))
    return replace(_with_noise(log, random), load=(load,))


def draw_change(seed: int, change: Callable[[Load], Load], span: tuple[float, float]) -> Log:
    """A log whose load changes to another one, from the first to the second of two times, s."""
    random = np.random.default_rng([62, seed])
    load, motion = draw_load(random), Motion(random)
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    place, turn = motion.at(time)
    width = max(span[1] - span[0], 1e-9)
    share = np.clip((time - span[0] + 1e-9) / width, 0.0, 1.0)[:, None]
    both = [wrench_on_load(motion, one, time) for one in (load, change(load))]
    wrench = -((1.0 - share) * both[0] + share * both[1]) + ZERO
    return _with_noise(Log(time, place, turn, wrench, (load, change(load))), random)


def draw_static(seed: int, zero: Array = ZERO) -> Log:
    """A table of 24 static poses without time."""
    random = np.random.default_rng([63, seed])
    load = draw_load(random)
    turn = Rotation.random(ROWS, random_state=int(random.integers(2**31)))
    force = turn.inv().apply(np.tile(load.mass * UP, (ROWS, 1)))
    wrench = -np.hstack([force, np.cross(load.com, force)]) + zero
    return _with_noise(Log(None, np.zeros((ROWS, 3)), turn, wrench, (load,)), random)


def _with_noise(log: Log, random: np.random.Generator) -> Log:
    count = len(log.wrench)
    shaken = log.turn * Rotation.from_rotvec(TURN_STD * random.normal(size=(count, 3)))
    std = np.repeat([FORCE_STD, TORQUE_STD], 3)
    return replace(
        log,
        place=log.place + PLACE_STD * random.normal(size=(count, 3)),
        turn=shaken,
        wrench=log.wrench + std * random.normal(size=(count, 6)),
    )


def write_log(log: Log, path: Path, torque: bool = True) -> Path:
    """Write a log as a table of columns with plain names."""
    names, columns = [], []
    if log.time is not None:
        names += ["t", "x", "y", "z", "qx", "qy", "qz", "qw"]
        columns += [log.time[:, None], log.place, log.turn.as_quat()]
    else:
        names += [f"r{i}{j}" for i in "123" for j in "123"]
        columns += [log.turn.as_matrix().reshape(-1, 9)]
    names += ["fx", "fy", "fz", "tx", "ty", "tz"][: 6 if torque else 3]
    columns += [log.wrench[:, : 6 if torque else 3]]
    table = np.hstack(columns)
    np.savetxt(path, table, fmt="%.6g", delimiter=",", header=",".join(names), comments="")
    return path


def _scaled(*scale: float) -> Corruption:
    return lambda log, _: replace(log, wrench=log.wrench * np.array(scale))


def _turned_world(turn: Rotation) -> Corruption:
    return lambda log, _: replace(log, place=turn.apply(log.place), turn=turn * log.turn)


def _any_world(log: Log, random: np.random.Generator) -> Log:
    turn = Rotation.random(random_state=int(random.integers(2**31)))
    return replace(log, place=turn.apply(log.place), turn=turn * log.turn)


def _tilted(log: Log, random: np.random.Generator) -> Log:
    heading = random.uniform(0.0, 2.0 * np.pi)
    axis = np.array([np.cos(heading), np.sin(heading), 0.0])
    return _turned_world(Rotation.from_rotvec(np.radians(9.0) * axis))(log, random)


def _mirrored_world(axis: int) -> Corruption:
    mirror = np.eye(3)
    mirror[axis, axis] = -1.0

    def corrupt(log: Log, _: np.random.Generator) -> Log:
        turn = Rotation.from_matrix(mirror @ log.turn.as_matrix() @ mirror)
        return replace(log, place=log.place @ mirror, turn=turn)

    return corrupt


def _inverse(log: Log, _: np.random.Generator) -> Log:
    return replace(log, turn=log.turn.inv())


def _inverse_pose(log: Log, _: np.random.Generator) -> Log:
    return replace(log, turn=log.turn.inv(), place=-log.turn.inv().apply(log.place))


def _sensor_turned(turn: Rotation) -> Corruption:
    def corrupt(log: Log, _: np.random.Generator) -> Log:
        parts = [turn.apply(log.wrench[:, :3]), turn.apply(log.wrench[:, 3:])]
        return replace(log, wrench=np.hstack(parts))

    return corrupt


def _in_world(log: Log, _: np.random.Generator) -> Log:
    parts = [log.turn.apply(log.wrench[:, :3]), log.turn.apply(log.wrench[:, 3:])]
    return replace(log, wrench=np.hstack(parts))


def _order(log: Log, _: np.random.Generator) -> Log:
    return replace(log, turn=Rotation.from_quat(np.roll(log.turn.as_quat(), 1, axis=1)))


def _low_pass(log: Log, _: np.random.Generator) -> Log:
    b, a = butter(2, 10.0, fs=RATE_HZ)
    start = log.wrench[:1]
    return replace(log, wrench=start + lfilter(b, a, log.wrench - start, axis=0))


def _quantised(log: Log, _: np.random.Generator) -> Log:
    step = np.repeat([1.0, 0.1], 3)
    return replace(log, wrench=np.round(log.wrench / step) * step)


def _zeroed(log: Log, random: np.random.Generator) -> Log:
    assert log.time is not None
    at = int(random.uniform(0.35, 0.65) * len(log.time))
    wrench = log.wrench.copy()
    wrench[at:] -= wrench[at]
    return replace(log, wrench=wrench)


def _bad_rows(log: Log, random: np.random.Generator) -> Log:
    wrong, repeated, source = random.choice(ROWS, 3, replace=False)
    wrench = log.wrench.copy()
    wrench[repeated] = wrench[source]
    wrench[wrong] *= [1.0, -1.0, 1.0, 1.0, 1.0, 1.0]
    return replace(log, wrench=wrench)


CORRUPTIONS: Mapping[str, Corruption] = {
    "force_sign": _scaled(*[-1.0] * 6),
    "torque_sign": _scaled(1, 1, 1, -1, -1, -1),
    "torque_in_n_cm": _scaled(1, 1, 1, 1e2, 1e2, 1e2),
    "torque_in_n_mm": _scaled(1, 1, 1, 1e3, 1e3, 1e3),
    "force_mirrored_x": _scaled(-1, 1, 1, 1, 1, 1),
    "force_mirrored_y": _scaled(1, -1, 1, 1, 1, 1),
    "force_mirrored_z": _scaled(1, 1, -1, 1, 1, 1),
    "torque_mirrored_x": _scaled(1, 1, 1, -1, 1, 1),
    "torque_mirrored_y": _scaled(1, 1, 1, 1, -1, 1),
    "torque_mirrored_z": _scaled(1, 1, 1, 1, 1, -1),
    "world_mirrored_x": _mirrored_world(0),
    "world_mirrored_y": _mirrored_world(1),
    "world_mirrored_z": _mirrored_world(2),
    "inverse_rotation": _inverse,
    "inverse_pose": _inverse_pose,
    "quaternion_order": _order,
    "gravity_along_x": _turned_world(Rotation.from_euler("y", -90, degrees=True)),
    "gravity_along_-x": _turned_world(Rotation.from_euler("y", 90, degrees=True)),
    "gravity_along_y": _turned_world(Rotation.from_euler("x", 90, degrees=True)),
    "gravity_along_-y": _turned_world(Rotation.from_euler("x", -90, degrees=True)),
    "gravity_along_z": _turned_world(Rotation.from_euler("x", 180, degrees=True)),
    "gravity_anywhere": _any_world,
    "base_tilted": _tilted,
    "sensor_turned_90": _sensor_turned(Rotation.from_euler("z", 90, degrees=True)),
    "sensor_turned_37": _sensor_turned(
        Rotation.from_rotvec(np.radians(37) * np.array([0, 0.6, 0.8]))
    ),
    "forces_in_world": _in_world,
}
"""Mistakes with units, signs and axes."""
FAULTS: Mapping[str, Corruption] = {
    "clean": lambda log, _: log,
    "low_pass_10_hz": _low_pass,
    "quantised_1_n": _quantised,
    "zeroed": _zeroed,
}
"""What sensors and people at them do during a log of one load."""
STATIC_FAULTS: Mapping[str, Corruption] = {
    "static_clean": lambda log, _: log,
    "static_bad_rows": _bad_rows,
    "static_turned": _sensor_turned(Rotation.from_euler("z", 180, degrees=True)),
    "static_world": _in_world,
}
"""What tables of static poses have wrong."""


def corrupted(log: Log, corrupt: Corruption, seed: int) -> Log:
    """A log with something done wrong, drawn by its own seed."""
    return corrupt(log, np.random.default_rng([64, seed]))


def heavier(load: Load) -> Load:
    """Half a kilogram more of the same shape."""
    return load.scaled(load.mass + 0.5)


def opened(load: Load) -> Load:
    """A gripper that opens: the centre moves by 1 cm."""
    return Load(load.mass, load.com + np.array([0.004, 0.0, -0.01]), load.inertia)
