"""MuJoCo's identification toolbox on the same recordings; runs where `mujoco[sysid]` is installed.

Its usual way, rollouts of the model under recorded controls, does not fit held objects: thirty
seconds of measured contact forces integrate to metres of drift. It is fed instead as its residual
functions allow: `mj_inverse` of a free body along the smoothed motion against the measured wrench.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
from collections.abc import Callable
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import inertia_vector, pseudo_inertia

Array = np.ndarray
Whiten = Callable[[Array], Array]

_BODY = "object"
_BOUND = np.repeat([10.0, 10.0, 5.0], [1, 3, 6])
_ITERATIONS = 40


def mujoco_is_there() -> bool:
    """Whether the toolbox can be imported."""
    return all(
        importlib.util.find_spec(name)
        for name in ("mujoco", "absl", "colorama", "imageio", "plotly")
    )


def identify_with_mujoco(samples: WrenchSamples, whiten: Whiten, guess: Array) -> Array:
    """Dynamic parameters (10,) by `mujoco.sysid.optimize` over its pseudo-inertia coordinates.

    Args:
        samples: smoothed motion and measured wrenches.
        whiten: of wrenches (N, 6) to residuals (6 N,).
        guess: (10,) dynamic parameters to start from.
    """
    from mujoco import sysid
    from mujoco.sysid._src.model_modifier import (
        apply_body_theta_inertia,
        pi_from_theta,
        theta_from_pseudoinertia,
    )

    spec = _free_body()
    start = theta_from_pseudoinertia(pseudo_inertia(guess))
    parameter = sysid.Parameter("inertia", start, start - _BOUND, start + _BOUND)
    measured = whiten(samples.measured_wrench)

    def residual(values: Array, _: Any) -> tuple[list[Array], None, None]:
        columns = []
        for theta in np.atleast_2d(np.asarray(values).T):
            apply_body_theta_inertia(spec, _BODY, theta)
            columns.append(whiten(_inverse_dynamics(spec.compile(), samples)) - measured)
        stacked = np.array(columns).T
        return [stacked if np.ndim(values) > 1 else stacked[:, 0]], None, None

    known = sysid.ParameterDict({"inertia": parameter})
    with contextlib.redirect_stdout(io.StringIO()):
        found, _ = sysid.optimize(known, residual, verbose=False, max_iters=_ITERATIONS)
    pi = pi_from_theta(found.as_vector())
    return np.concatenate([pi[:4], inertia_vector(pi[4:].reshape(3, 3))])


def _free_body() -> Any:
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, -9.81]
    body = spec.worldbody.add_body(name=_BODY, mass=1.0, inertia=[1e-3] * 3, ipos=[0.0] * 3)
    body.explicitinertial = True
    body.add_freejoint()
    return spec


def _inverse_dynamics(model: Any, samples: WrenchSamples) -> Array:
    """(N, 6) [torque about the origin, force], body frame, that the motion takes."""
    import mujoco

    data = mujoco.MjData(model)
    wrench = np.empty((len(samples.time), 6))
    for k, rotation in enumerate(samples.rotation):
        data.qpos[:3] = samples.position[k]
        mujoco.mju_mat2Quat(data.qpos[3:], rotation.ravel())
        data.qvel[:3], data.qvel[3:] = samples.velocity[k], samples.angular_velocity[k]
        data.qacc[:3], data.qacc[3:] = samples.acceleration[k], samples.angular_acceleration[k]
        mujoco.mj_inverse(model, data)
        wrench[k, :3] = data.qfrc_inverse[3:]
        wrench[k, 3:] = rotation.T @ data.qfrc_inverse[:3]
    return wrench
