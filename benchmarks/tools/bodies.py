"""Boxes and cylinders of known shape in a hand that hardly moves: even, with ballast, hollow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import trimesh

from benchmarks.inertia.scores import deviations
from tactile_dynamics_ros.core.inertia.batch.fitting import fit_from
from tactile_dynamics_ros.core.inertia.estimate import FROM_SHAPE, estimate
from tactile_dynamics_ros.core.inertia.shape_prior import ShapePrior
from tactile_dynamics_ros.core.inertia.shape_weighing import with_shape
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.shape.object_shape import MeshSurface, ObjectShape
from tactile_dynamics_ros.core.shape.solid import Solid
from tactile_dynamics_ros.synthetic.objects import HeldObject, shifted_inertia
from tactile_dynamics_ros.synthetic.recordings import record
from tactile_dynamics_ros.synthetic.scenario import Scenario, ScenarioOptions

KINDS = ("even", "ballast", "hollow")
"""What is in the body: nothing but itself; half of its mass at one end; a tenth of its width."""
_WALL = 0.1
"""Thickness of the walls of a hollow body, over its width."""
_LITTLE = ScenarioOptions(
    duration=10.0,
    band_hz=(0.2, 1.0),
    position_peak=(0.01, 0.03),
    angle_peak_deg=(8.0, 20.0),
)
"""A hand that hardly turns: without the shape, inertia is known to its own size or not at all."""


@dataclass(frozen=True)
class Outcome:
    """One body in one recording.

    Attributes:
        kind: of KINDS. seed: of everything.
        plain, shaped: (10,) errors in standard deviations, without and with the shape.
        narrower: (10,) standard deviations with the shape over those without.
        moments: (3,) relative errors of the principal moments with the shape.
        contradicts: whether the shape is said to be contradicted. where: what is said of it.
    """

    kind: str
    seed: int
    plain: np.ndarray
    shaped: np.ndarray
    narrower: np.ndarray
    moments: np.ndarray
    contradicts: bool
    where: str


def outcomes(kinds: tuple[str, ...], seeds: range) -> Iterator[Outcome]:
    """Record and estimate bodies of each kind."""
    for kind in kinds:
        for seed in seeds:
            yield judge(kind, seed)


def judge(kind: str, seed: int) -> Outcome:
    """Estimate one body without and with its shape."""
    scenario = Scenario.draw(seed, _LITTLE)
    body = filled(scenario.body, kind, np.random.default_rng([seed, 66]))
    recorded = record(replace(scenario, body=body), (), None)
    truth = InertialParameters(body.mass, body.com, body.inertia_com)
    prior = ShapePrior(Solid.of_shape(ObjectShape([MeshSurface(mesh_of(body))])))
    fitted = estimate(recorded.streams)
    plain = fitted.to_estimate()
    found, weighed = with_shape(fit_from(fitted, prior.start, FROM_SHAPE), prior)
    principal = [np.linalg.eigvalsh(one.inertia_com) for one in (found.inertia, truth)]
    return Outcome(
        kind,
        seed,
        deviations(plain, truth),
        deviations(found, truth),
        found.parameter_std / plain.parameter_std,
        principal[0] / principal[1] - 1.0,
        weighed.contradicts,
        weighed.where,
    )


def mesh_of(body: HeldObject) -> trimesh.Trimesh:
    """Surface of a body, about its origin."""
    if body.shape == "box":
        return trimesh.creation.box(body.size)
    return trimesh.creation.cylinder(0.5 * body.size[0], body.size[2])


def filled(body: HeldObject, kind: str, rng: np.random.Generator) -> HeldObject:
    """The same shape and mass with another inside."""
    even = _even(body)
    if kind == "hollow":
        inner = replace(body, size=body.size - 2.0 * _WALL * body.size[0])
        share = float(np.prod(inner.size / body.size))
        inertia = (even - share * _even(inner)) / (1.0 - share)
        return replace(body, com=np.zeros(3), inertia_com=body.mass * inertia)
    if kind == "even":
        return replace(body, com=np.zeros(3), inertia_com=body.mass * even)
    at = body.size * np.append(rng.uniform(-0.2, 0.2, 2), rng.choice([-0.4, 0.4]))
    inertia = 0.5 * even + shifted_inertia(0.5, 0.5 * at) + shifted_inertia(0.5, -0.5 * at)
    return replace(body, com=0.5 * at, inertia_com=body.mass * inertia)


def _even(body: HeldObject) -> np.ndarray:
    """Inertia (3, 3) of an even body of 1 kg about its middle."""
    if body.shape == "box":
        return np.diag(body.size @ body.size - body.size**2) / 12.0
    radius, height = 0.5 * body.size[0], body.size[2]
    across = (3.0 * radius**2 + height**2) / 12.0
    return np.diag([across, across, 0.5 * radius**2])
