"""Contract test of an effect, ours or a user's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W, WrenchSamples
from tactile_dynamics_ros.core.contract import CheckReport, central_differences
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.parameter import parse_unit
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, skew, twice

_TOLERANCE = 5e-3
"""Difference between a derivative and its finite difference, as a share of the largest entry of the
column: rounding and curvature leave below 1e-4 in our effects, a wrong sign or factor far more.
Lower reports bends as faults, higher passes a small term that is left out."""
_SPAN_TOLERANCE = 0.05
"""Share of the energy of a screening basis that may change with the choice of frames. Bases that
are right change by rounding only; those of a fixed axis of the world by tens of per cent. Lower
reports what finite differences round, higher passes a weak dependence."""


def example_samples(
    count: int = 200, seed: int = 0, turning_contacts: bool = True
) -> WrenchSamples:
    """Four contacts on a body in rich smooth motion, forces that balance it; for checks.

    Args:
        count: samples at 100 Hz.
        seed: of the motion.
        turning_contacts: whether the contact frames turn in the body.
    """
    random = np.random.default_rng(seed)
    time = 0.01 * np.arange(count, dtype=np.float64)
    hz = random.uniform(0.3, 1.1, (2, 3, 3))
    phase = random.uniform(0.0, 2.0 * np.pi, (2, 3, 3))
    size = np.array([0.05, 0.25])[:, None, None] * random.uniform(0.5, 1.0, (2, 3, 3))
    argument = 2.0 * np.pi * hz * time[:, None, None, None] + phase
    rate = 2.0 * np.pi * hz
    position = (size * np.sin(argument)).sum(-1)[:, 0] + np.array([0.4, 0.1, 0.6])
    velocity = (size * rate * np.cos(argument)).sum(-1)[:, 0]
    acceleration = -(size * rate**2 * np.sin(argument)).sum(-1)[:, 0]
    omega = 4.0 * (size * np.cos(argument)).sum(-1)[:, 1]
    change = -4.0 * (size * rate * np.sin(argument)).sum(-1)[:, 1]
    rotation = _integrate(omega, 0.01)
    points = np.array([[0.04, 0.0, 0.01], [-0.01, 0.04, 0], [-0.03, -0.03, 0.02], [0, 0.01, -0.05]])
    frames = exp_so3(random.normal(size=(4, 3)))[None] @ exp_so3(
        (0.3 if turning_contacts else 0.0) * np.sin(time)[:, None, None] * np.ones((4, 3))
    )
    samples = WrenchSamples(
        time=time,
        position=position,
        rotation=rotation,
        velocity=velocity,
        acceleration=acceleration,
        angular_velocity=omega,
        angular_acceleration=change,
        contact_names=("index", "middle", "ring", "thumb"),
        contact_point=np.tile(points, (count, 1, 1)),
        contact_rotation=np.broadcast_to(frames, (count, 4, 3, 3)).copy(),
        contact_force=np.zeros((count, 4, 3)),
        contact_torque=np.zeros((count, 4, 3)),
        in_contact=np.ones((count, 4), dtype=bool),
        gravity=GRAVITY_W,
    )
    grip = 1.5 + 0.5 * np.sin(2.0 * np.pi * np.array([0.3, 0.4, 0.55, 0.7]) * time[:, None])
    return samples.with_forces(balance_forces(samples, grip))


def example_inertia() -> Array:
    """Dynamic parameters (10,) of a 0.3 kg load."""
    matrix = 0.3 * np.diag([2e-3, 1e-3, 1.5e-3, 1.0])
    matrix[:3, 3] = matrix[3, :3] = 0.3 * np.array([0.004, -0.003, 0.006])
    return dynamic_parameters_from_pseudo_inertia(matrix)


def _integrate(omega: Array, period: float) -> Array:
    rotation = np.empty((len(omega), 3, 3))
    rotation[0] = exp_so3(np.array([0.2, -0.3, 0.1]))
    middle = 0.5 * (omega[1:] + omega[:-1])
    for k, step in enumerate(exp_so3(middle * period)):
        rotation[k + 1] = rotation[k] @ step
    return rotation


def balance_forces(samples: WrenchSamples, grip: Array) -> Array:
    """Point forces (N, C, 3) that carry the example load, with grip (N, C) along the normals."""
    target = _load(samples) @ example_inertia()
    arms = samples.contact_point
    unit = np.broadcast_to(np.eye(3), (*arms.shape, 3))
    maps = np.concatenate([skew(arms), unit], axis=2)
    grasp = np.concatenate(list(np.moveaxis(maps, 1, 0)), axis=2)
    wish = (grip[..., None] * samples.contact_rotation[..., 2]).reshape(len(grip), -1)
    lacking = target - (grasp @ wish[..., None])[..., 0]
    forces = wish + (np.linalg.pinv(grasp) @ lacking[..., None])[..., 0]
    return np.asarray(forces.reshape(arms.shape))


def _load(samples: WrenchSamples) -> Array:
    return regressor(
        samples.specific_acceleration, samples.angular_velocity, samples.angular_acceleration
    )


def check_effect(effect: Effect, samples: WrenchSamples | None = None) -> CheckReport:
    """Test what the estimator and the diagnosis rely on, for every reading of the effect.

    Shapes, units, absence at theta = 0, Jacobians against central differences, a screening
    family that contains the effect near absence, and independence of the choice of frames.

    Args:
        effect: the effect to test.
        samples: motion and contacts to test on; a rich example by default.
    """
    samples = samples or example_samples()
    failures: list[str] = []
    for reading in effect.readings(samples):
        inertia = example_inertia()
        for test in _TESTS:
            try:
                failures += [f"{reading.label}: {line}" for line in test(reading, samples, inertia)]
            except Exception as error:  # the report names what a foreign effect raised
                failures.append(f"{reading.label}: {test.__name__} raised {error!r}")
                break
    return CheckReport(effect.name, tuple(failures))


def _check_text(effect: Effect, samples: WrenchSamples, inertia: Array) -> list[str]:
    found = [
        f"class attribute `{name}` is empty"
        for name in ("name", "formula", "looks_like", "remedy")
        if not getattr(effect, name)
    ]
    parameters = effect.parameters(samples)
    names = [p.name for p in parameters]
    if len(set(names)) < len(names):
        found.append(f"parameter names repeat: {names}")
    for p in parameters:
        parse_unit(p.unit)
        if not p.prior_std > 0:
            found.append(f"parameter {p.name}: prior_std = {p.prior_std}, expected > 0")
    return found


def _check_kind(effect: Effect, samples: WrenchSamples, inertia: Array) -> list[str]:
    """Effects computed from forces have to say whether they are wrenches on the object."""
    theta = effect.typical(samples)
    other = samples.with_forces(1.1 * samples.contact_force)
    change = effect.wrench(other, inertia, theta) - effect.wrench(samples, inertia, theta)
    stated = any("external" in vars(kind) for kind in type(effect).__mro__[:-1] if kind != Effect)
    if stated or not effect.external or np.abs(change).max() < 1e-9:
        return []
    return [
        "depends on forces: state the class attribute `external`, False for an error of what "
        "sensors read, True for a wrench on the object"
    ]


def _check_shapes(effect: Effect, samples: WrenchSamples, inertia: Array) -> list[str]:
    theta = effect.typical(samples)
    count, width = len(samples.time), len(theta)
    basis = effect.screening_basis(samples, inertia)
    columns = basis.shape[-1]
    guess = effect.initial_guess(samples, inertia, np.ones(columns), np.zeros((count, 6)))
    found = []
    for what, value, shape in (
        ("wrench", effect.wrench(samples, inertia, theta), (count, 6)),
        ("jacobian", effect.jacobian(samples, inertia, theta), (count, 6, width)),
        ("inertia_jacobian", effect.inertia_jacobian(samples, inertia, theta), (count, 6, 10)),
        ("screening_basis", basis, (count, 6, columns)),
        ("initial_guess", guess, (width,)),
    ):
        if value.shape != shape:
            found.append(f"{what} has shape {value.shape}, expected {shape}")
        elif not np.all(np.isfinite(value)):
            found.append(f"{what} is not finite")
    absent = np.abs(effect.wrench(samples, inertia, effect.zero(samples))).max()
    if absent > 1e-12:
        found.append(f"wrench at theta = 0 is {absent:.3g}, expected 0")
    return found


def _check_jacobians(effect: Effect, samples: WrenchSamples, inertia: Array) -> list[str]:
    theta = effect.typical(samples)
    scales = np.array([p.prior_std for p in effect.parameters(samples)])
    by_theta = central_differences(
        lambda x: effect.wrench(samples, inertia, x), theta, 1e-5 * scales
    )
    by_phi = central_differences(
        lambda x: effect.wrench(samples, x, theta), inertia, np.full(10, 1e-7)
    )
    found = []
    for what, analytic, numeric, scale in (
        ("jacobian", effect.jacobian(samples, inertia, theta), by_theta, scales),
        ("inertia_jacobian", effect.inertia_jacobian(samples, inertia, theta), by_phi, 1.0),
    ):
        size = np.abs(numeric * scale).max(axis=(0, 1)) + 1e-9 * np.abs(numeric * scale).max()
        error = np.abs((analytic - numeric) * scale).max(axis=(0, 1))
        for k in np.flatnonzero(error > _TOLERANCE * np.maximum(size, 1e-9)):
            found.append(
                f"{what} column {k} differs from finite differences "
                f"by {error[k]:.2g} of {size[k]:.2g}"
            )
    return found


def _check_factors(effect: Effect, samples: WrenchSamples, inertia: Array) -> list[str]:
    theta = effect.typical(samples)
    found = effect.factored(samples, theta)
    if found is None:
        return []
    columns, weights = found
    other = effect.factored(samples, 0.5 * theta)
    if other is None or not np.array_equal(columns, other[0]):
        return ["factored: the columns depend on theta"]
    jacobian = effect.jacobian(samples, inertia, theta)
    if not np.allclose(columns @ weights, jacobian, rtol=0.0, atol=1e-9 * np.abs(jacobian).max()):
        return ["factored: columns times weights differ from the jacobian"]
    numbers, wrench = effect.coefficients(samples, theta), effect.wrench(samples, inertia, theta)
    if numbers is None or np.allclose(
        columns @ numbers, wrench, rtol=0.0, atol=1e-9 * np.abs(wrench).max()
    ):
        return []
    return ["coefficients: columns times numbers differ from the wrench"]


def _check_screening(effect: Effect, samples: WrenchSamples, inertia: Array) -> list[str]:
    """The screening family, with the load's own columns, must hold most of the typical wrench."""
    wrench = effect.wrench(samples, inertia, effect.typical(samples))
    basis = effect.screening_basis(samples, inertia)
    missing = _outside(wrench[..., None], np.concatenate([basis, _load(samples)], axis=2))
    if missing > 0.3:
        return [f"screening_basis leaves {100 * missing:.0f} % of a typical wrench: want < 30 %"]
    return []


def _check_frames(effect: Effect, samples: WrenchSamples, inertia: Array) -> list[str]:
    """The screening family must not depend on world yaw and origin, nor on the body axes."""
    basis = effect.screening_basis(samples, inertia)
    moved = _move_world(samples)
    turned, turned_inertia, turn = _turn_body(samples, inertia)
    in_new_axes = effect.screening_basis(turned, turned_inertia)
    in_old_axes = np.einsum("ij,njm->nim", twice(turn), in_new_axes)
    found = []
    for what, other in (
        ("world frame", effect.screening_basis(moved, inertia)),
        ("body axes", in_old_axes),
    ):
        missing = max(_outside(basis, other), _outside(other, basis))
        if missing > _SPAN_TOLERANCE:
            found.append(f"the effect depends on the choice of {what} ({100 * missing:.0f} %)")
    return found


def _outside(columns: Array, basis: Array) -> float:
    """Share of the columns' energy that the basis cannot express."""
    weight = np.tile(np.array([20.0, 20.0, 20.0, 1.0, 1.0, 1.0]), len(columns))[:, None]
    left = columns.reshape(weight.size, -1) * weight
    right = basis.reshape(weight.size, -1) * weight
    right = right / np.maximum(np.linalg.norm(right, axis=0), 1e-300)
    basis_q, singular, _ = np.linalg.svd(right, full_matrices=False)
    basis_q = basis_q[:, singular > 1e-9 * singular[0]]
    left = left / np.maximum(np.linalg.norm(left, axis=0), 1e-300)
    rest = left - basis_q @ (basis_q.T @ left)
    return float(np.linalg.norm(rest)) / max(float(np.linalg.norm(left)), 1e-300)


def _move_world(samples: WrenchSamples) -> WrenchSamples:
    yaw = exp_so3(np.array([0.0, 0.0, 0.7]))
    return replace(
        samples,
        position=samples.position @ yaw.T + np.array([0.3, -0.2, 0.1]),
        rotation=yaw @ samples.rotation,
        velocity=samples.velocity @ yaw.T,
        acceleration=samples.acceleration @ yaw.T,
    )


def _turn_body(samples: WrenchSamples, inertia: Array) -> tuple[WrenchSamples, Array, Array]:
    """Samples and inertia in new body axes and the matrix R_OldNew."""
    turn = exp_so3(np.array([0.3, -0.5, 0.4]))
    to_new = turn.T
    change = np.eye(4)
    change[:3, :3] = to_new
    turned = replace(
        samples,
        rotation=samples.rotation @ turn,
        angular_velocity=samples.angular_velocity @ turn,
        angular_acceleration=samples.angular_acceleration @ turn,
        contact_point=samples.contact_point @ turn,
        contact_rotation=to_new @ samples.contact_rotation,
        contact_force=samples.contact_force @ turn,
        contact_torque=samples.contact_torque @ turn,
    )
    matrix = change @ pseudo_inertia(inertia) @ change.T
    return turned, dynamic_parameters_from_pseudo_inertia(matrix), turn


_TESTS = (
    _check_text,
    _check_kind,
    _check_shapes,
    _check_jacobians,
    _check_factors,
    _check_screening,
    _check_frames,
)
"""Tests in the order in which they make sense: what has no shape has no derivative. In another
order the report would begin with consequences of a fault."""
