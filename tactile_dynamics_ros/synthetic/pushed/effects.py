"""What is hidden in a recording: made physically, at a multiple of a typical size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tactile_dynamics_ros.synthetic.pushed import influences
from tactile_dynamics_ros.synthetic.pushed.bodies import rotation
from tactile_dynamics_ros.synthetic.pushed.friction_field import FrictionField
from tactile_dynamics_ros.synthetic.pushed.objects import GRAVITY, Link
from tactile_dynamics_ros.synthetic.pushed.scene import STEP, Change, Scene


@dataclass(frozen=True)
class Faults:
    """What a force sensor does wrong, in the axes of the pusher.

    Attributes:
        bias: (3,) N. gain: factor. angle: rad about the vertical. delay: s, stamps are late by.
    """

    bias: np.ndarray = field(default_factory=lambda: np.zeros(3))
    gain: float = 1.0
    angle: float = 0.0
    delay: float = 0.0

    def applied(self, force: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """Return forces (N, 3) as they are sent by a sensor that is turned by yaw (N,)."""
        turned = force.copy()
        turned[:, :2] = self.gain * force[:, :2] @ rotation(np.array(self.angle)).T
        bias = np.repeat(self.bias[None], len(force), axis=0)
        bias[:, :2] = np.einsum("nij,j->ni", rotation(yaw), self.bias[:2])
        return turned + bias


@dataclass(frozen=True)
class Hidden:
    """A scene with something hidden in it.

    Attributes:
        scene: as it is simulated.
        faults: of the sensor, if it has any.
        parameters: true values by name, SI.
    """

    scene: Scene
    faults: Faults | None = None
    parameters: dict[str, object] = field(default_factory=dict)


Maker = Callable[[Scene, float, np.random.Generator], Hidden]


def _direction(rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _inside(scene: Scene, rng: np.random.Generator, share: float = 0.6) -> np.ndarray:
    """Draw a point of link_1."""
    return np.asarray(share * 0.5 * np.ptp(scene.thing.links[0].corners, axis=0) * _direction(rng))


def _mass(scene: Scene) -> float:
    return sum(link.mass for link in scene.thing.links)


def _with(scene: Scene, influence: object, **parameters: object) -> Hidden:
    acting = (*scene.influences, influence)
    return Hidden(replace(scene, influences=acting), parameters=parameters)


def _support_tilt(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    angle, way = np.radians(2.0) * size, _direction(rng)
    gravity = GRAVITY * np.array([*(np.sin(angle) * way), -np.cos(angle)])
    return Hidden(replace(scene, gravity=gravity), parameters={"angle": angle, "direction": [*way]})


def _viscous_support(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    viscosity = 4.0 * size
    return Hidden(replace(scene, viscosity=viscosity), parameters={"coefficient": viscosity})


def _velocity_weakening(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    lost = min(0.25 * size, 0.9)
    weak = replace(scene, weakening=lost, weakening_speed=0.04)
    return Hidden(weak, parameters={"lost": lost, "speed": 0.04})


def _anisotropic_support(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    ratio, angle = 0.3 * size, rng.uniform(0.0, np.pi)
    turn = rotation(np.array(angle))
    stretch = turn @ np.diag([1.0 + 0.5 * ratio, 1.0 / (1.0 + 0.5 * ratio)]) @ turn.T
    parameters = {"ratio": (1.0 + 0.5 * ratio) ** 2, "direction": angle}
    return Hidden(replace(scene, stretch=stretch), parameters=parameters)


def _friction_gradient(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    gradient = 1.0 * size * _direction(rng)
    table = scene.field or FrictionField.even()
    steeper = replace(table, gradient=table.gradient + gradient)
    return Hidden(replace(scene, field=steeper), parameters={"gradient": [*gradient]})


def _concentrated_pressure(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    amount = 1.2 * size * _sign(rng)
    links = tuple(_concentrated(link, amount) for link in scene.thing.links)
    thing = replace(scene.thing, links=links)
    return Hidden(replace(scene, thing=thing), parameters={"towards_rim": amount})


def _concentrated(link: Link, amount: float) -> Link:
    half = 0.5 * np.ptp(link.corners, axis=0)
    squared = np.sum(((link.feet - link.feet.mean(axis=0)) / half) ** 2, axis=1)
    spread = (squared - squared.mean()) / squared.std()
    return replace(link, stiffness=link.stiffness * np.exp(amount * spread))


def _tether_spring(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    stiffness, anchor, point = 6.0 * size, 0.12 * _direction(rng), _inside(scene, rng)
    tether = influences.Tether(stiffness, anchor, point)
    return _with(scene, tether, stiffness=stiffness, anchor=[*anchor], point=[*point])


def _constant_pull(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    holds = sum(link.friction * link.mass for link in scene.thing.links) * GRAVITY
    force, point = min(0.3 * size, 0.6 * holds) * _direction(rng), _inside(scene, rng)
    return _with(scene, influences.Pull(force, point), force=[*force], point=[*point])


def _start_of_action(scene: Scene, rng: np.random.Generator) -> float:
    """Draw a time at rest near the middle of the recording."""
    ends = np.cumsum([len(action.path) for action in scene.actions]) * STEP
    k = int(rng.integers(len(ends) // 3, max(len(ends) // 3 + 1, 2 * len(ends) // 3)))
    return float(ends[min(k, len(ends) - 1)] - 0.04)


def _friction_change(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    factor, time = float(np.exp(0.25 * size * _sign(rng))), _start_of_action(scene, rng)
    change = Change(time, friction=factor)
    return Hidden(replace(scene, change=change), parameters={"factor": factor, "time": time})


def _load_change(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    mass, time = 0.2 * size * _mass(scene), _start_of_action(scene, rng)
    place = scene.thing.links[0].com + 0.3 * _inside(scene, rng)
    change = Change(time, mass=mass, place=place)
    parameters = {"mass": mass, "time": time, "place": [*place]}
    return Hidden(replace(scene, change=change), parameters=parameters)


def _force_bias(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    bias = np.array([*(0.15 * size * _direction(rng)), 0.0])
    return Hidden(scene, Faults(bias=bias), {"bias": [*bias]})


def _force_scale(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    gain = float(np.exp(0.1 * size * _sign(rng)))
    return Hidden(scene, Faults(gain=gain), {"gain": gain})


def _sensor_rotation(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    angle = np.radians(4.0) * size * _sign(rng)
    return Hidden(scene, Faults(angle=angle), {"angle": angle})


def _time_offset(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    delay = 0.012 * size * _sign(rng)
    return Hidden(scene, Faults(delay=delay), {"delay": delay})


def _loose_joint(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    play = 0.002 * size
    return Hidden(replace(scene, thing=replace(scene.thing, play=play)), parameters={"play": play})


def _caster(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    share = min(0.3 * size, 0.6)
    point, heading = _inside(scene, rng, 0.3), rng.uniform(0.0, 2.0 * np.pi)
    load = share * scene.thing.links[0].mass * GRAVITY
    return _with(scene, influences.Caster(load, 0.6, 0.015, point, heading), load=load)


def _magnet(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    strength, place = 1.5 * size, 0.05 * _direction(rng)
    magnet = influences.Magnet(strength, 0.03, place, _inside(scene, rng, 0.4))
    return _with(scene, magnet, strength=strength, place=[*place])


def _shaker(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    force, frequency = 0.6 * size, rng.uniform(5.0, 12.0)
    shaker = influences.Shaker(force, frequency, _inside(scene, rng, 0.4))
    return _with(scene, shaker, force=force, frequency_hz=frequency)


def _loose_ballast(scene: Scene, size: float, rng: np.random.Generator) -> Hidden:
    mass = 0.2 * size * scene.thing.links[0].mass
    play = 0.2 * float(np.ptp(scene.thing.links[0].corners, axis=0).min())
    middle = scene.thing.links[0].com
    ballast = influences.LooseBallast(mass, 0.15, play, middle)
    return _with(scene, ballast, mass=mass, play=play)


_CATALOGUED: dict[str, Maker] = {
    "support_tilt": _support_tilt,
    "viscous_support": _viscous_support,
    "velocity_weakening": _velocity_weakening,
    "anisotropic_support": _anisotropic_support,
    "friction_gradient": _friction_gradient,
    "concentrated_pressure": _concentrated_pressure,
    "tether_spring": _tether_spring,
    "constant_pull": _constant_pull,
    "friction_change": _friction_change,
    "load_change": _load_change,
    "force_bias": _force_bias,
    "force_scale": _force_scale,
    "sensor_rotation": _sensor_rotation,
    "time_offset": _time_offset,
}
_UNKNOWN: dict[str, Maker] = {
    "caster": _caster,
    "magnet": _magnet,
    "shaker": _shaker,
    "loose_ballast": _loose_ballast,
}
_JOINTED: dict[str, Maker] = {"loose_joint": _loose_joint}
CATALOGUE, OUTSIDE, JOINTED = tuple(_CATALOGUED), tuple(_UNKNOWN), tuple(_JOINTED)


def hide(name: str, magnitude: float, scene: Scene, rng: np.random.Generator) -> Hidden:
    """Return a scene in which something is hidden.

    Args:
        name: one of CATALOGUE or OUTSIDE, or of JOINTED for two parts on a hinge.
        magnitude: multiple of the typical size.
        scene: without it.
        rng: of directions, places and times.

    Raises:
        KeyError: there is no such effect for this object; names those that exist.
    """
    makers = {**_CATALOGUED, **_UNKNOWN, **(_JOINTED if scene.thing.joint is not None else {})}
    if name not in makers:
        raise KeyError(f"no hidden effect {name!r}; there are {', '.join(makers)}")
    return makers[name](scene, magnitude, rng)
