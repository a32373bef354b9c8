"""Tips and pads against the sides of objects: compliance, stick and slip; their sensors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.sim.bodies import ContactReading
from tactile_dynamics_ros.sim.planar.body import PlanarBody
from tactile_dynamics_ros.sim.planar.table import Outline, outlines

BURIED = 0.002
"""Depth of the middle of a rounded point in an outline, m, at which it stands on the object instead
of touching its side: 40 N press a tip in by 2 mm of its radius."""


@dataclass(frozen=True)
class Skin:
    """How a tip or a pad gives way.

    Attributes:
        stiffness, shear: N/m along and across the normal. damping: N s/m.
        friction: coefficient against the object's sides.
    """

    stiffness: float
    shear: float
    damping: float
    friction: float


@dataclass(frozen=True)
class Side:
    """The outline of one part of an object, which points may touch; vectors as complex numbers.

    Attributes:
        body, k: which rigid part it moves with.
        start, edge: (E,) m, of its edges, anticlockwise, object's frame.
        squared: (E,) m^2, of the edges' lengths.
        middle: m, and reach, m, of a circle around it. height: m.
    """

    body: PlanarBody
    k: int
    start: NDArray[np.complex128]
    edge: NDArray[np.complex128]
    squared: Array
    middle: complex
    reach: float
    height: float

    @classmethod
    def of(cls, link: Outline) -> Side:
        """Return the side of a part."""
        start = _plane(link.part.corners)
        edge = np.roll(start, -1) - start
        reach = float(np.abs(_plane(link.corners)).max())
        middle, height = complex(*link.middle), link.part.height
        return cls(link.body, link.k, start, edge, np.abs(edge) ** 2, middle, reach, height)

    def nearest(self, place: complex) -> tuple[complex, complex, float]:
        """Return the nearest point, the inward normal there and how deep a place lies inside, m."""
        away = place - self.start
        share = (away * self.edge.conj()).real / self.squared
        gap = away - np.minimum(np.maximum(share, 0.0), 1.0) * self.edge
        n = int((gap.real**2 + gap.imag**2).argmin())
        offset, edge = complex(gap[n]), complex(self.edge[n])
        distance = abs(offset)
        inside = (edge.conjugate() * offset).imag > 0.0
        if distance < 1e-9:
            return place - offset, 1j * edge / abs(edge), 0.0
        depth = distance if inside else -distance
        return place - offset, offset / depth, depth


def sides_of(bodies: Sequence[PlanarBody]) -> list[Side]:
    """Return the outlines of all parts of all objects."""
    return [Side.of(link) for body in bodies for link in outlines(body)]


@dataclass
class _Sums:
    """What points did to objects over some steps: sums over points and steps."""

    steps: int = 0
    touched: int = 0
    force: complex = 0j
    load: float = 0.0
    place: complex = 0j
    height: float = 0.0
    facing: complex = 0j
    moment: float = 0.0

    def add(
        self, force: complex, load: float, place: complex, height: float, normal: complex
    ) -> None:
        """Add what one point does in one step."""
        self.force += force
        self.load += load
        self.place += load * place
        self.height += load * height
        self.facing += load * normal
        self.moment += (place.conjugate() * force).imag


class Touch:
    """Points of one tip or pad, rounded, that move together and touch sides.

    Args:
        name: of the contact.
        places: (P, 2) m, middles of the rounded points, in the axes of the gripper.
        radius: m, of each.
        skin: of all points together.

    Attributes:
        buried: whether a point came down on an object, where nothing is pushed any more.
    """

    def __init__(self, name: str, places: Array, radius: float, skin: Skin) -> None:
        self.name, self._radius, self._skin = name, radius, skin
        self.move(places)
        self.buried = False
        self._sheared: dict[tuple[int, int], float] = {}
        self._sums = _Sums()

    def move(self, places: Array) -> None:
        """Put the points elsewhere in the gripper, (P, 2) m."""
        self._places = [complex(x, y) for x, y in places]
        self._reach = self._radius + max(abs(place) for place in self._places)

    def act(self, sides: Sequence[Side], frame: Array, motion: Array, step: float) -> None:
        """Push what is touched during the coming step.

        Args:
            sides: of all objects.
            frame: (4,) x, y, z (m) and turn (rad) of the gripper.
            motion: (4,) its rates.
            step: s.
        """
        self._sums.steps += 1
        x, y, height, yaw = frame.tolist()
        vx, vy, _, rate = motion.tolist()
        turn, load = complex(np.cos(yaw), np.sin(yaw)), self._sums.load
        for n, side in enumerate(sides):
            pose = side.body.state(side.k)[0]
            middle = _turn(pose) * side.middle + complex(pose[0, 3], pose[1, 3])
            near = abs(middle - complex(x, y)) < side.reach + self._reach
            if not near or height > pose[2, 3] + side.height:
                continue
            for i, place in enumerate(self._places):
                arm = turn * place
                speed = complex(vx, vy) + 1j * rate * arm
                self._press((n, i), side, complex(x, y) + arm, speed, height, step)
        self._sums.touched += self._sums.load > load

    def read(self, time: float) -> ContactReading:
        """Return the means since the last call and start anew.

        Args:
            time: s, of the middle of the window.
        """
        sums, self._sums = self._sums, _Sums()
        self.buried = False
        if not sums.touched:
            zero = np.zeros(3)
            return ContactReading(self.name, time, False, zero, zero, zero, zero, 0.0)
        place, force = sums.place / sums.load, sums.force / sums.steps
        normal = sums.facing / max(abs(sums.facing), 1e-12)
        turning = sums.moment / sums.steps - (place.conjugate() * force).imag
        return ContactReading(
            name=self.name,
            time=time,
            in_contact=True,
            force=np.array([force.real, force.imag, 0.0]),
            torque=np.array([0.0, 0.0, turning]),
            point=np.array([place.real, place.imag, sums.height / sums.load]),
            normal=np.array([normal.real, normal.imag, 0.0]),
            share=sums.touched / sums.steps,
        )

    def _press(
        self,
        key: tuple[int, int],
        side: Side,
        place: complex,
        speed: complex,
        height: float,
        step: float,
    ) -> None:
        """Let one point push one part, if it touches it."""
        pose, angular, linear = side.body.state(side.k)
        turn, origin = _turn(pose), complex(pose[0, 3], pose[1, 3])
        near, normal, depth = side.nearest((place - origin) / turn)
        self.buried |= depth > BURIED
        depth += self._radius
        if depth <= 0.0 or self.buried:
            self._sheared.pop(key, None)
            return
        arm, normal = turn * near, turn * normal
        slip = speed - complex(linear[0], linear[1]) - 1j * angular[2] * arm
        into = slip * normal.conjugate()
        skin, share = self._skin, 1.0 / len(self._places)
        load = max(share * (skin.stiffness * depth + skin.damping * into.real), 0.0)
        sheared = self._sheared.get(key, 0.0) + step * into.imag
        rubbed = share * (skin.shear * sheared + skin.damping * into.imag)
        rubbed = min(max(rubbed, -skin.friction * load), skin.friction * load)
        self._sheared[key] = (rubbed / share - skin.damping * into.imag) / skin.shear
        force, at = complex(load, rubbed) * normal, arm + origin
        side.body.push(
            side.k, np.array([force.real, force.imag, 0.0]), np.array([at.real, at.imag, height])
        )
        self._sums.add(force, load, at, height, normal)


def _plane(points: Array) -> NDArray[np.complex128]:
    """Return points (K, 2) as complex numbers."""
    return np.asarray(points[:, 0] + 1j * points[:, 1])


def _turn(pose: Array) -> complex:
    """Return the turn of a pose about the vertical as a complex number."""
    return complex(pose[0, 0], pose[1, 0])


@dataclass(frozen=True)
class TouchSensorConfig:
    """Errors of three-axis sensors that are tared before they touch.

    Source: logs of arrays of nine pillars under load, of which a sum has 0.033 to 0.115 N of noise
    along the normal and 0.017 N across it.
    """

    force_noise: float = parameter(0.03, "white noise of a force axis", "N", 0.0, 1.0)
    point_noise: float = parameter(
        3e-4, "white noise of the contact point, each axis", "m", 0, 0.01
    )
    height_offset: float = parameter(0.0, "lasting error of the contact's height", "m", -0.02, 0.02)
    touch_force: float = parameter(0.15, "below it nothing is touched", "N", 0.0, 5.0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class TouchReading:
    """What the sensor of one contact reports.

    Attributes:
        name: of the contact.
        time: s, of the force.
        force: (3,) N on the object, world axes; zero where nothing is touched.
        raw: (3,) N, as it was measured, noise alone where nothing is touched.
        pose: (4, 4) in the world: the contact point, z the normal into the object.
        touching: whether anything is touched.
    """

    name: str
    time: float
    force: Array
    raw: Array
    pose: Array
    touching: bool


class TouchSensors:
    """Sensors of tip and pads.

    Args:
        config: errors.
        seed: of the noise.
    """

    def __init__(self, config: TouchSensorConfig, seed: int) -> None:
        self.config, self._rng = config, np.random.default_rng([seed, 61])

    @property
    def force_std(self) -> Array:
        """(3,) standard deviation of a reported force, N."""
        return np.full(3, max(self.config.force_noise, 1e-4))

    def read(self, contacts: Iterable[ContactReading], rest: Array) -> list[TouchReading]:
        """Return what the sensors report.

        Args:
            contacts: of tip and pads, forces on the object in world axes.
            rest: pose (4, 4) of the tip, told where nothing is touched.
        """
        return [self._read(contact, rest) for contact in contacts]

    def _read(self, contact: ContactReading, rest: Array) -> TouchReading:
        config = self.config
        force = contact.force + config.force_noise * self._rng.standard_normal(3)
        error = config.point_noise * self._rng.standard_normal(3)
        error[2] += config.height_offset
        if not contact.in_contact or np.linalg.norm(force) < config.touch_force:
            return TouchReading(contact.name, contact.time, np.zeros(3), force, rest, False)
        pose = np.eye(4)
        across = np.array([-contact.normal[1], contact.normal[0], 0.0])
        pose[:3, :3] = np.column_stack([across, np.array([0.0, 0.0, 1.0]), contact.normal])
        pose[:3, 3] = contact.point + error
        return TouchReading(contact.name, contact.time, force, force, pose, True)
