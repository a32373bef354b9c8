"""What each effect leaves in the balance of a held object on one standard motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects import create_effect
from tactile_dynamics_ros.core.effects.check import (
    balance_forces,
    example_inertia,
    example_samples,
)
from tactile_dynamics_ros.core.effects.held.gravity import load_regressor
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.report.style import (
    AXIS_COLOURS,
    BLUE,
    GREY,
    ORANGE,
    QUIET,
    label_lines,
    new_figure,
)

PHASES = (("holds", 0.0, 2.0), ("moves", 2.0, 5.0), ("turns", 5.0, 9.0), ("squeezes", 9.0, 11.4))
RATE = 100.0
_TORQUE_WEIGHT = 20.0
_FADE = 0.9
_HERTZ = ((1.0, 0.7, 1.3), (0.5, 0.8, 0.35))
_TRAVEL, _TURN = np.array([0.05, 0.06, 0.05]), np.array([0.6, 0.5, 0.7])
_LEAST_FORCE, _LEAST_TORQUE = 0.03, 1.5
_SHOWN = 3
_WORLD = ("viscous_drag", "quadratic_drag", "tether_spring", "hanging_cable", "added_mass",
          "mass_change", "gravity_tilt", "sloshing_mass", "time_offset")  # fmt: skip
ONE_FINGER = ("force_bias", "force_drift", "force_scale", "sensor_rotation", "contact_offset",
              "sensor_zeroed")  # fmt: skip
_HAPPENS = 7.0
"""When an event happens, s of the standard motion: in the middle of turning, where weight shows."""


@cache
def standard_motion() -> WrenchSamples:
    """Return a hand that holds a load still, moves, turns and squeezes it, one after the other."""
    time = np.arange(0.0, PHASES[-1][2], 1.0 / RATE)
    position, turn = _path(time)
    rotation = exp_so3(turn)
    velocity = np.gradient(position, time, axis=0)
    omega = RATE / 2 * log_so3(np.swapaxes(rotation[:-2], 1, 2) @ rotation[2:])
    omega = np.pad(omega, ((1, 1), (0, 0)), mode="edge")
    samples = replace(
        example_samples(len(time), turning_contacts=False),
        time=time,
        position=position,
        rotation=rotation,
        velocity=velocity,
        acceleration=np.gradient(velocity, time, axis=0),
        angular_velocity=omega,
        angular_acceleration=np.gradient(omega, time, axis=0),
    )
    squeeze = _window(time, *PHASES[3][1:]) * np.sin(np.pi * (time - PHASES[3][1]) / 1.2) ** 2
    grip = 1.5 + 3.0 * squeeze[:, None] * np.ones(4)
    return samples.with_forces(balance_forces(samples, grip))


def _path(time: Array) -> tuple[Array, Array]:
    """Position and rotation vector, (N, 3) each."""
    moves, turns = (
        _window(time, start, stop) * np.sin(2.0 * np.pi * np.outer(hz, time - start))
        for hz, (_, start, stop) in zip(_HERTZ, PHASES[1:3], strict=True)
    )
    return np.array([0.5, 0.0, 0.6]) + moves.T * _TRAVEL, turns.T * _TURN


def _window(time: Array, start: float, stop: float) -> Array:
    """1 between start and stop with smooth ends, 0 elsewhere."""
    edge = np.clip(np.minimum(time - start, stop - time) / _FADE, 0.0, 1.0)
    return np.asarray(edge**3 * (10.0 - 15.0 * edge + 6.0 * edge**2))


@dataclass(frozen=True)
class Signature:
    """What the rigid body, fitted as well as it can, lacks.

    Attributes:
        samples: the standard motion.
        frame: `world` or `body`, the axes of force and torque.
        force: (N, 3) N.
        torque: (N, 3) N m about the body origin.
        effect: label of the effect that was applied.
    """

    samples: WrenchSamples
    frame: str
    force: Array
    torque: Array
    effect: str

    @property
    def body_force(self) -> Array:
        """Force in body axes."""
        return _turned(self.samples, self.force, self.frame, "body")

    @property
    def world_force(self) -> Array:
        """Force in world axes."""
        return _turned(self.samples, self.force, self.frame, "world")

    @property
    def body_torque(self) -> Array:
        """Torque in body axes."""
        return _turned(self.samples, self.torque, self.frame, "body")


def compute_signature(name: str) -> Signature:
    """Return the wrench of an effect at typical size less what inertial parameters explain."""
    samples, inertia = standard_motion(), example_inertia()
    when = f"[t>{_HAPPENS:g}]" if create_effect(name).event else ""
    effect = create_effect(f"{name}{when}:thumb" if name in ONE_FINGER else f"{name}{when}")
    wrench = effect.wrench(samples, inertia, effect.typical(samples))
    weight = np.array([_TORQUE_WEIGHT] * 3 + [1.0] * 3)
    matrix = (load_regressor(samples) * weight[:, None]).reshape(-1, 10)
    explained = matrix @ np.linalg.lstsq(matrix, (wrench * weight).ravel(), rcond=None)[0]
    lacking = wrench - explained.reshape(wrench.shape) / weight
    frame = "world" if name in _WORLD else "body"
    torque, force = (
        _turned(samples, part, "body", frame) for part in (lacking[:, :3], lacking[:, 3:])
    )
    return Signature(samples, frame, force, torque, effect.label)


def _turned(samples: WrenchSamples, vectors: Array, source: str, target: str) -> Array:
    if source == target:
        return vectors
    pattern = "nij,nj->ni" if target == "world" else "nji,nj->ni"
    return np.asarray(np.einsum(pattern, samples.rotation, vectors))


def draw_signature(name: str) -> Figure:
    """Draw force and torque over the standard motion, and one telling relation."""
    signature = compute_signature(name)
    figure = new_figure(2.2)
    force, torque, relation = figure.subplots(1, 3, width_ratios=(1.15, 1.15, 0.9))
    _draw_course(force, signature.samples.time, signature.force, _LEAST_FORCE)
    _draw_course(torque, signature.samples.time, 1e3 * signature.torque, _LEAST_TORQUE)
    force.set_title("missing in the balance", fontsize=9)
    force.set_ylabel("force in N")
    torque.set_ylabel("torque in N mm")
    label_lines(torque, [*"xy", f"z of the {signature.frame}"])
    _RELATIONS[name](relation, signature)
    return figure


def _draw_course(axes: Axes, time: Array, values: Array, least: float) -> None:
    reach = 1.15 * max(float(np.abs(values).max()), least)
    for k, (phase, start, stop) in enumerate(PHASES):
        if k % 2:
            axes.axvspan(start, stop, color=GREY, alpha=0.13, linewidth=0)
        axes.annotate(
            phase, (0.5 * (start + stop), 0.0), (0, 2), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", color=QUIET, fontsize=7,
        )  # fmt: skip
    for axis, (name, colour) in enumerate(AXIS_COLOURS.items()):
        axes.plot(time[::_SHOWN], values[::_SHOWN, axis], color=colour, label=name)
    axes.set_xlim(time[0], time[-1])
    axes.set_ylim(-1.25 * reach, reach)
    axes.set_xticks([])
    axes.set_xlabel("time")


def _scatter(axes: Axes, x: Array, y: Array, xlabel: str, ylabel: str) -> None:
    axes.plot(x[::_SHOWN], y[::_SHOWN], ".", color=BLUE, markersize=2.2, alpha=0.8)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)


def _along(vectors: Array, direction: Array) -> Array:
    """Component of vectors along directions; nan where there is no direction."""
    size = np.linalg.norm(direction, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.einsum("ni,ni->n", vectors, direction) / size
    return np.asarray(np.where(size > 0.02 * size.max(), found, np.nan))


def _against_speed(axes: Axes, s: Signature) -> None:
    speed = np.linalg.norm(s.samples.velocity, axis=1)
    force = _along(s.world_force, s.samples.velocity)
    _scatter(axes, speed, force, "speed in m/s", "force along v in N")


def _against_turning(axes: Axes, s: Signature) -> None:
    omega = s.samples.angular_velocity
    torque = 1e3 * _along(s.body_torque, omega)
    rate = np.linalg.norm(omega, axis=1)
    _scatter(axes, rate, torque, "turn rate in rad/s", "torque along ω in N mm")


def _across_turning(axes: Axes, s: Signature) -> None:
    omega = s.samples.angular_velocity
    rate = np.linalg.norm(omega, axis=1)
    along = 1e3 * _along(s.body_torque, omega)
    total = 1e3 * np.linalg.norm(s.body_torque, axis=1)
    across = np.sqrt(np.maximum(total**2 - along**2, 0.0))
    _two(axes, rate, (("across ω", across), ("along ω", along)))
    axes.set_xlabel("turn rate in rad/s")
    axes.set_ylabel("torque in N mm")


def _two(axes: Axes, x: Array, series: tuple[tuple[str, Array], ...]) -> None:
    for (label, y), colour in zip(series, (BLUE, ORANGE), strict=True):
        axes.plot(x[::_SHOWN], y[::_SHOWN], ".", color=colour, markersize=2.2, label=label)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    label_lines(axes, [label for label, _ in series], markerscale=3)


def _frames(axes: Axes, s: Signature) -> None:
    """The same component in both frames against the angle that the object has turned."""
    angle = np.degrees(np.linalg.norm(log_so3(s.samples.rotation), axis=1))
    axis = int(np.argmax(np.abs(s.force.mean(axis=0))))
    name = "xyz"[axis]
    _two(axes, angle, (("world", s.world_force[:, axis]), ("body", s.body_force[:, axis])))
    axes.set_xlabel("turned by, in degrees")
    axes.set_ylabel(f"force {name} in N")


def _by_axis(axes: Axes, x: Array, y: Array) -> None:
    for axis, (name, colour) in enumerate(AXIS_COLOURS.items()):
        xs, ys = x[::_SHOWN, axis], y[::_SHOWN, axis]
        axes.plot(xs, ys, ".", color=colour, markersize=2.2, label=name)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    label_lines(axes, list(AXIS_COLOURS), markerscale=3)


def _against_place(axes: Axes, s: Signature) -> None:
    _by_axis(axes, 1e3 * (s.samples.position - s.samples.position[0]), s.world_force)
    axes.set_xlabel("displacement in mm")
    axes.set_ylabel("force in N")


def _against_spin(axes: Axes, s: Signature) -> None:
    _by_axis(axes, s.samples.angular_velocity, 1e3 * s.body_torque)
    axes.set_xlabel("turn rate in rad/s")
    axes.set_ylabel("torque in N mm")


def _against_acceleration(axes: Axes, s: Signature) -> None:
    force = _along(s.world_force, s.samples.acceleration)
    size = np.linalg.norm(s.samples.acceleration, axis=1)
    _scatter(axes, size, force, "acceleration in m/s²", "force along a in N")


def _spectrum(axes: Axes, s: Signature) -> None:
    taper = np.hanning(len(s.force))[:, None]
    size = np.abs(np.fft.rfft(taper * s.world_force, 4096, axis=0)).sum(axis=1)
    hz = np.fft.rfftfreq(4096, 1.0 / RATE)
    kept = hz < 6.0
    axes.plot(hz[kept], size[kept] / size.max(), color=BLUE)
    axes.set_ylim(0.0, 1.1)
    axes.set_xlabel("frequency in Hz")
    axes.set_ylabel("share of the force")


def _weight_over_time(axes: Axes, s: Signature) -> None:
    _scatter(axes, s.samples.time, s.world_force[:, 2], "time in s", "vertical force in N")


def _drift_over_time(axes: Axes, s: Signature) -> None:
    axis = int(np.argmax(np.ptp(s.body_force, axis=0)))
    y = s.body_force[:, axis]
    _scatter(axes, s.samples.time, y, "time in s", f"force {'xyz'[axis]} (body) in N")


def _thumb(s: Signature) -> Array:
    return s.samples.contact_force[:, s.samples.contact_names.index("thumb")]


def _torque_against_grip(axes: Axes, s: Signature) -> None:
    grip = np.linalg.norm(_thumb(s), axis=1)
    torque = 1e3 * np.linalg.norm(s.body_torque, axis=1)
    _scatter(axes, grip, torque, "force of the thumb in N", "torque in N mm")


def _along_and_across_thumb(axes: Axes, s: Signature) -> None:
    force = _thumb(s)
    along = _along(s.body_force, force)
    total = np.linalg.norm(s.body_force, axis=1)
    across = np.sqrt(np.maximum(total**2 - along**2, 0.0))
    _two(axes, np.linalg.norm(force, axis=1), (("along it", along), ("across it", across)))
    axes.set_xlabel("force of the thumb in N")
    axes.set_ylabel("missing force in N")


def _against_world_change(axes: Axes, s: Signature) -> None:
    force = np.einsum("nij,nj->ni", s.samples.rotation, s.samples.measured_wrench[:, 3:])
    _against_change(axes, s.samples.time, force, s.world_force)


def _moment_over_time(axes: Axes, s: Signature) -> None:
    torque = 1e3 * np.linalg.norm(s.body_torque, axis=1)
    _scatter(axes, s.samples.time, torque, "time in s", "size of the torque in N mm")


def _against_body_change(axes: Axes, s: Signature) -> None:
    _against_change(axes, s.samples.time, s.samples.measured_wrench[:, 3:], s.body_force)


def _against_change(axes: Axes, time: Array, force: Array, lacking: Array) -> None:
    _by_axis(axes, np.gradient(force, time, axis=0), lacking)
    axes.set_xlabel("change of the force in N/s")
    axes.set_ylabel("force in N")


_RELATIONS: dict[str, Callable[[Axes, Signature], None]] = {
    "viscous_drag": _against_speed,
    "quadratic_drag": _against_speed,
    "rotational_drag": _against_turning,
    "tether_spring": _against_place,
    "hanging_cable": _frames,
    "unsensed_contact": _frames,
    "spinning_rotor": _across_turning,
    "sloshing_mass": _spectrum,
    "added_mass": _against_acceleration,
    "mass_change": _weight_over_time,
    "gravity_tilt": _frames,
    "contact_torsion": _against_spin,
    "contact_offset": _torque_against_grip,
    "force_bias": _frames,
    "force_drift": _drift_over_time,
    "force_scale": _along_and_across_thumb,
    "sensor_rotation": _along_and_across_thumb,
    "sensor_lag": _against_body_change,
    "time_offset": _against_world_change,
    "sensor_zeroed": _drift_over_time,
    "payload_change": _weight_over_time,
    "grasp_shift": _moment_over_time,
}
