"""An arm without a hand in Bullet: a trajectory controller, a wrist sensor, a tool and a load."""

from __future__ import annotations

import math
import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import pybullet_data

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.sim.bodies import Engine, link_indices, to_matrix
from tactile_dynamics_ros.sim.carried import SENSOR, Carried, bolted_link, with_carried
from tactile_dynamics_ros.sim.sensors.fingertips import WristSensor, WristSensorConfig

TIME_STEP = 1e-3
"""Simulation step, s, as of the other scenes."""
_START = (0.0, 0.5, 0.0, -1.4, 0.0, 0.9, 0.0)
"""Joints at the start, rad: the flange 0.6 m before the base, pointing down."""
_STIFFNESS, _DAMPING = 6400.0, 160.0
"""Of the controller, 1/s^2 and 1/s on each joint's own inertia: 13 Hz, critically damped, as
compliant as arms that people may touch; 1.5 kg that the controller does not know make the flange
sag by some millimetres."""
_NOTHING = 1e-6
"""Mass, kg, of a load that is not there: Bullet takes a link of none for one that stands still."""


@dataclass(frozen=True)
class CarryingArmConfig:
    """What the arm carries; everything random follows from the seed."""

    seed: int = parameter(0, "of tool, load and noise", "", 0)
    encoder_noise: float = parameter(1e-5, "white noise of a joint", "rad", 0.0, 0.1)
    wrist: WristSensorConfig = field(
        default_factory=lambda: WristSensorConfig(
            force_noise_xy=0.05,
            force_noise_z=0.08,
            torque_noise_xy=3e-3,
            torque_noise_z=2e-3,
            force_drift=1e-3,
            torque_drift=2e-5,
            filter_hz=500.0,
        )
    )

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class ArmReadings:
    """What the sensors report.

    Attributes:
        time: s, middle of the period over which all is averaged.
        position, velocity, effort: (J,) rad, rad/s, N m.
        wrist: (6,) [torque, force] of what is carried on the sensor.
    """

    time: float
    position: Array
    velocity: Array
    effort: Array
    wrist: Array


class CarryingArm(Engine):
    """A KUKA iiwa that follows joint trajectories and knows the payload that it was given.

    Computed torque: tau = M(q) (ddq_d + k (q_d - q) + d (dq_d - dq)) + h(q, dq), where M and h are
    those of the arm with the payload that its controller knows. What it does not know makes it sag.

    Args:
        config: what is carried.
        period: s between readings.

    Attributes:
        tool, load: what is carried. attached: whether the load is.
        time: simulated seconds. names: of the joints. urdf: text, without what is carried.
    """

    def __init__(self, config: CarryingArmConfig | None = None, period: float = 0.01) -> None:
        super().__init__()
        self.config = config or CarryingArmConfig()
        rng = np.random.default_rng([self.config.seed, 71])
        self.tool = Carried.draw(rng, (0.4, 0.9), 0.05)
        self.load = Carried.draw(rng, (0.8, 2.0), 0.16)
        self.attached = False
        self.time, self.period = 0.0, period
        self.urdf = self.load_urdf()
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self.client)
        pybullet.setTimeStep(TIME_STEP, physicsClientId=self.client)
        self._body = _spawn(self.client, with_carried(self.urdf, [self.tool, self.load]))
        self._links = link_indices(self.client, self._body)
        infos = [pybullet.getJointInfo(self._body, k, self.client) for k in self._links.values()]
        moving = [info for info in infos if info[2] == pybullet.JOINT_REVOLUTE]
        self._joints = [info[0] for info in moving]
        self.names = tuple(info[1].decode() for info in moving)
        self._reset()
        self._rng = np.random.default_rng([self.config.seed, 72])
        self._sensor = WristSensor(self.config.wrist, self.config.seed)
        self._trajectory: tuple[float, Array, Array, Array] | None = None
        self._target = np.array(_START)
        self._at = self._link_pose(SENSOR)
        self._places: dict[str, Array] = {}
        self.set_load(False)
        self._known_client = Engine()
        self.set_payload(0.0, np.zeros(3), np.zeros((3, 3)))

    def close(self) -> None:
        """Free both engines."""
        self._known_client.close()
        super().close()

    @staticmethod
    def load_urdf() -> str:
        """Return the arm's URDF with the sensor's link and absolute paths of meshes."""
        folder = Path(pybullet_data.getDataPath()) / "kuka_iiwa"
        root = ElementTree.fromstring((folder / "model.urdf").read_text())
        for mesh in root.iter("mesh"):
            mesh.attrib["filename"] = str(folder / mesh.attrib["filename"])
        root.extend(bolted_link(SENSOR, "lbr_iiwa_link_7", (0.0, 0.0, 0.045), None))
        return ElementTree.tostring(root, encoding="unicode")

    def set_load(self, attached: bool) -> None:
        """Attach the load to the tool, or take it off."""
        self.attached = attached
        share = 1.0 if attached else _NOTHING / self.load.mass
        pybullet.changeDynamics(
            self._body,
            self._links["load"],
            mass=share * self.load.mass,
            localInertiaDiagonal=(share * self.load.moments).tolist(),
            physicsClientId=self.client,
        )
        self._note_momentum()

    def set_payload(self, mass: float, com: Array, inertia_com: Array) -> None:
        """Tell the controller what the flange's sensor carries, tool and load together.

        Each payload has an engine of its own: Bullet keeps a body's inverse dynamics by its
        address, and a body loaded where one was removed gets those of the removed.

        Args:
            mass: kg.
            com: (3,) m, sensor's frame.
            inertia_com: (3, 3) kg m^2, about the centre of mass.
        """
        self._known_client.close()
        self._known_client = Engine()
        client = self._known_client.client
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        root = ElementTree.fromstring(self.urdf)
        inertia = (max(mass, _NOTHING), com, inertia_com, np.zeros(3))
        root.extend(bolted_link("payload", SENSOR, (0.0, 0.0, 0.0), inertia))
        self._known = _spawn(client, ElementTree.tostring(root, encoding="unicode"))

    def follow(self, names: list[str], time: Array, position: Array, velocity: Array) -> None:
        """Follow a trajectory from now on, instead of what was followed.

        Args:
            names: of the joints, all of them, in any order.
            time: (N,) s from now, increasing.
            position: (N, J) rad, order of the names.
            velocity: (N, J) rad/s.

        Raises:
            BadInputError: joints are missing or unknown, or times do not increase.
        """
        if sorted(names) != sorted(self.names):
            raise BadInputError(
                f"trajectory: joints {', '.join(names) or 'none'}; expected all of "
                f"{', '.join(self.names)}"
            )
        if len(time) == 0 or time[0] < 0.0 or np.any(np.diff(time) <= 0.0):
            raise BadInputError("trajectory: time_from_start must be there and increase")
        order = [names.index(name) for name in self.names]
        desired, rate, _ = self._desired()
        knots = np.concatenate([[0.0], time]) if time[0] > 0.0 else time
        ahead = [desired] if time[0] > 0.0 else []
        rates = [rate] if time[0] > 0.0 else []
        self._trajectory = (
            self.time,
            knots,
            np.vstack([*ahead, position[:, order]]),
            np.vstack([*rates, velocity[:, order]]),
        )

    def advance(self) -> ArmReadings:
        """Simulate one period; all readings are means over it.

        Bullet's velocities are those of a step earlier, so that momentum follows from places.
        """
        count = round(self.period / TIME_STEP)
        states, torque = [], np.zeros(len(self.names))
        before = self._momentum
        for _ in range(count):
            states.append(np.array(self._state()))
            torque += self._drive() / count
            pybullet.stepSimulation(physicsClientId=self.client)
            self.time += TIME_STEP
            self._note_momentum()
        position, velocity = np.mean(states, axis=0)
        wrench = self._wrench_between(before, self._momentum)
        noise = self.config.encoder_noise * self._rng.standard_normal(len(position))
        wrist, _ = self._sensor.read(wrench, self.period)
        middle = self.time - 0.5 * (self.period + TIME_STEP)
        return ArmReadings(middle, position + noise, velocity, torque, wrist)

    def sag(self) -> float:
        """Return how far the sensor's frame is from where the controller wants it, m."""
        found = self._link_pose(SENSOR)[:3, 3]
        desired, _, _ = self._desired()
        client, known = self._known_client.client, self._known
        for joint, value in zip(self._joints, desired, strict=True):
            pybullet.resetJointState(known, joint, value, physicsClientId=client)
        link = link_indices(client, known)[SENSOR]
        wanted = pybullet.getLinkState(known, link, 0, 1, physicsClientId=client)[4]
        return float(math.dist(found, wanted))

    def reveal(self) -> dict[str, Any]:
        """Return the truth as plain numbers."""
        return {
            "tool": self.tool.to_json(),
            "load": self.load.to_json(),
            "attached": self.attached,
            "sag_m": self.sag(),
        }

    def _reset(self) -> None:
        for joint, value in zip(self._joints, _START, strict=True):
            pybullet.resetJointState(self._body, joint, value, physicsClientId=self.client)
        for link in range(len(self._links)):
            pybullet.changeDynamics(
                self._body, link, jointDamping=0.0, linearDamping=0.0, angularDamping=0.0,
                physicsClientId=self.client,
            )  # fmt: skip
        pybullet.setJointMotorControlArray(
            self._body, self._joints, pybullet.VELOCITY_CONTROL, forces=[0.0] * len(self._joints),
            physicsClientId=self.client,
        )  # fmt: skip

    def _state(self) -> tuple[Array, Array]:
        states = pybullet.getJointStates(self._body, self._joints, self.client)
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def _desired(self) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (J,) that are wanted now.

        Between points a cubic that meets positions and velocities, as joint_trajectory_controller
        interpolates.
        """
        if self._trajectory is None:
            return self._target, np.zeros(len(self._target)), np.zeros(len(self._target))
        begun, knots, position, velocity = self._trajectory
        elapsed = self.time - begun
        if elapsed >= knots[-1]:
            self._target, self._trajectory = position[-1], None
            return self._desired()
        k = max(int(np.searchsorted(knots, elapsed, side="right")) - 1, 0)
        span = knots[k + 1] - knots[k]
        s = (elapsed - knots[k]) / span
        move = position[k + 1] - position[k]
        first, last = span * velocity[k], span * velocity[k + 1]
        square, cube = 3.0 * move - 2.0 * first - last, first + last - 2.0 * move
        place = position[k] + first * s + square * s**2 + cube * s**3
        rate = (first + 2.0 * square * s + 3.0 * cube * s**2) / span
        return place, rate, (2.0 * square + 6.0 * cube * s) / span**2

    def _drive(self) -> Array:
        """Apply the controller's torques for the coming step and return them."""
        client, known = self._known_client.client, self._known
        position, velocity = self._state()
        desired, rate, bend = self._desired()
        wanted = bend + _STIFFNESS * (desired - position) + _DAMPING * (rate - velocity)
        torque = np.array(
            pybullet.calculateInverseDynamics(
                known, position.tolist(), velocity.tolist(), wanted.tolist(), physicsClientId=client
            )
        )
        pybullet.setJointMotorControlArray(
            self._body, self._joints, pybullet.TORQUE_CONTROL, forces=torque.tolist(),
            physicsClientId=self.client,
        )  # fmt: skip
        return torque

    def _link_pose(self, name: str, centre: bool = False) -> Array:
        """Return the pose (4, 4) of a link, or of its centre of mass with its principal axes."""
        state = pybullet.getLinkState(
            self._body, self._links[name], 0, 1, physicsClientId=self.client
        )
        return to_matrix(*state[:2]) if centre else to_matrix(*state[4:6])

    def _note_momentum(self) -> None:
        """Keep what tool and load had in the middle of the last step, by where they have moved."""
        sensor = self._link_pose(SENSOR)
        places = {name: self._link_pose(name, centre=True) for name in ("tool", "load")}
        total = _Momentum(np.zeros(3), np.zeros(3), 0.0, np.zeros(3), _halfway(self._at, sensor))
        for name, body in (("tool", self.tool), ("load", self.load)):
            if name == "load" and not self.attached:
                continue
            first, last = self._places.get(name, places[name]), places[name]
            turned = log_so3(first[:3, :3].T @ last[:3, :3]) / TIME_STEP
            middle = _halfway(first, last)
            velocity = (last[:3, 3] - first[:3, 3]) / TIME_STEP
            total.linear += body.mass * velocity
            total.angular += middle[:3, :3] @ (body.moments * turned)
            total.angular += body.mass * np.cross(middle[:3, 3], velocity)
            total.mass += body.mass
            total.place += body.mass * middle[:3, 3]
        self._momentum, self._places, self._at = total, places, sensor

    def _wrench_between(self, before: _Momentum, after: _Momentum) -> Array:
        """Return the mean [torque, force] (6,) of what is carried on the sensor over a period.

        F = dP/dt - m g and tau = dL/dt - sum m p x g act on it. Bullet's own joint reactions are
        not used: at 1 rad/s and 0.5 m/s they miss some 3 % of omega x v.
        """
        gravity = np.array([0.0, 0.0, -9.81])
        force = (after.linear - before.linear) / self.period - after.mass * gravity
        weight_at = 0.5 * (before.place + after.place)
        torque = (after.angular - before.angular) / self.period - np.cross(weight_at, gravity)
        middle = _halfway(before.sensor, after.sensor)
        local = middle[:3, :3].T @ np.stack(
            [torque - np.cross(middle[:3, 3], force), force], axis=1
        )
        return -np.asarray(local.T.ravel())


def _halfway(first: Array, last: Array) -> Array:
    """Return the pose (4, 4) halfway between two."""
    pose = np.eye(4)
    turn = log_so3(first[:3, :3].T @ last[:3, :3])
    pose[:3, :3] = first[:3, :3] @ exp_so3(0.5 * turn)
    pose[:3, 3] = 0.5 * (first[:3, 3] + last[:3, 3])
    return pose


@dataclass
class _Momentum:
    """What tool and load have together.

    Attributes:
        linear: (3,) N s. angular: (3,) N m s, about the world's origin.
        mass: kg. place: (3,) sum of m p, kg m.
        sensor: (4, 4) pose of the sensor.
    """

    linear: Array
    angular: Array
    mass: float
    place: Array
    sensor: Array


def _spawn(client: int, urdf: str) -> int:
    """Load a URDF with its base fixed, as its file states inertias."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(urdf)
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        body = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
    return int(body)
