"""How the Newton-Euler residual moves with the measured motion, forces and contact points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import inertia_matrix
from tactile_dynamics_ros.core.rigid_body.rotation import cross, skew

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


_FORCE_STEP = 1e-3
"""Step of a difference quotient by a force, N. Effects are linear in the forces or nearly so, and 1
mN is far above rounding (1e-16 of 10 N) and far below loads; for linear effects its size does not
matter. At 1 N effects that bend with the force are linearised over the load itself, at 1e-9 N
rounding shows."""


def body_sensitivity(samples: WrenchSamples, phi: Array) -> tuple[Array, Array, Array]:
    """Derivatives (N, 6, 3) of Y phi by s = R_OW (a - g), w and w' (all body frame).

    Args:
        samples: the motion.
        phi: (10,) dynamic parameters.
    """
    count = len(samples.time)
    first, inertia = phi[1:4], inertia_matrix(phi[4:])
    omega = samples.angular_velocity
    by_force, by_rate, by_change = (np.zeros((count, 6, 3)) for _ in range(3))
    by_force[:, :3], by_force[:, 3:] = skew(first), phi[0] * np.eye(3)
    by_rate[:, :3] = skew(omega) @ inertia - skew(omega @ inertia)
    by_rate[:, 3:] = -skew(cross(omega, first)) - skew(omega) @ skew(first)
    by_change[:, :3], by_change[:, 3:] = inertia, -skew(first)
    return by_force, by_rate, by_change


def motion_sensitivity(
    samples: WrenchSamples,
    phi: Array,
    has_imu: bool,
    has_gyro: bool,
    carried: NDArray[np.bool_] | None = None,
) -> dict[str, Array]:
    """Derivatives (N, O, 6, 3) of e = Y phi - w by value and derivatives of each motion signal.

    A world rotation d of the object changes a body-frame vector R^T x by R^T [x] d. Of rates read
    from rotation vectors about the present orientation half of that is in the vectors already.
    The lever b of a carried contact stays: its torque b x f changes by b x R^T [f] d.

    Args:
        samples: motion and contacts.
        phi: (10,) dynamic parameters.
        has_imu: whether accelerations are measured.
        has_gyro: whether angular velocities are.
        carried: (C,) contacts that carry the noise of the pose; none by default.

    Returns:
        By name: orientation (orders 0-2), position (0-2), and with an IMU specific_force (0) and
        gyro (0-1).
    """
    by_force, by_rate, by_change = body_sensitivity(samples, phi)
    to_body = np.swapaxes(samples.rotation, 1, 2)
    wrench = samples.measured_wrench
    turned = np.concatenate([skew(wrench[:, :3]), skew(wrench[:, 3:])], axis=1)
    moved = wrench[:, 3:]
    if carried is not None and carried.any():
        point, force = samples.contact_point[:, carried], samples.contact_force[:, carried]
        turned[:, :3] += (skew(force) @ skew(point)).sum(axis=1)
        moved = moved - force.sum(axis=1)
    turned = turned @ to_body
    orientation = np.stack([-turned, by_rate @ to_body, by_change @ to_body], axis=1)
    position = np.zeros_like(orientation)
    position[:, 0, :3] = -skew(moved) @ to_body
    signals = {}
    if has_imu:
        signals["specific_force"] = by_force[:, None]
    else:
        orientation[:, 0] += by_force @ skew(samples.specific_acceleration) @ to_body
        position[:, 2] = by_force @ to_body
    if has_gyro:
        signals["gyro"] = np.stack([by_rate, by_change], axis=1)
        orientation[:, 1:] = 0.0
    else:
        orientation[:, 0] += 0.5 * by_rate @ skew(samples.angular_velocity) @ to_body
        orientation[:, 0] += 0.5 * by_change @ skew(samples.angular_acceleration) @ to_body
    return signals | {"orientation": orientation, "position": position}


def contact_sensitivity(
    samples: WrenchSamples, contact: int, carried: bool = False
) -> dict[str, Array]:
    """Derivatives (N, 1, 6, 3) of e by the world-frame force, torque and point of one contact.

    The point of a carried contact is that in the body frame.
    """
    to_body = np.swapaxes(samples.rotation, 1, 2)
    zero = np.zeros_like(to_body)
    arm = skew(samples.contact_point[:, contact]) @ to_body
    by_force = np.concatenate([-arm, -to_body], axis=1)
    by_torque = np.concatenate([-to_body, zero], axis=1)
    lever = skew(samples.contact_force[:, contact])
    by_point = np.concatenate([lever if carried else lever @ to_body, zero], axis=1)
    return {"force": by_force[:, None], "torque": by_torque[:, None], "point": by_point[:, None]}


def force_sensitivity_of_effects(
    samples: WrenchSamples, phi: Array, effects: Sequence[Effect], theta: Sequence[Array]
) -> dict[str, Array]:
    """Derivatives (N, 1, 6, 3) of -sum Delta by the world-frame force of each contact.

    A gain or a rotation of a sensor scales its noise as well: without this part a large gain would
    seem to remove the residual. By differences of 1 mN, exact for effects linear in the forces.

    Returns:
        By signal name ``force:<contact>``; contacts on whose force no effect depends are left out.
    """
    found: dict[str, Array] = {}
    to_body = np.swapaxes(samples.rotation, 1, 2)
    for effect, value in zip(effects, theta, strict=True):
        start = effect.wrench(samples, phi, value)
        for index, contact in enumerate(samples.contact_names):
            columns = []
            for axis in np.eye(3):
                force = samples.contact_force.copy()
                force[:, index] += _FORCE_STEP * axis * samples.in_contact[:, index, None]
                moved = effect.wrench(samples.with_forces(force), phi, value)
                columns.append((start - moved) / _FORCE_STEP)
                if not columns[0].any():
                    break
            if columns[0].any():
                by_force = np.stack(columns, axis=2) @ to_body
                name = f"force:{contact}"
                found[name] = found.get(name, 0.0) + by_force[:, None]
    return found
