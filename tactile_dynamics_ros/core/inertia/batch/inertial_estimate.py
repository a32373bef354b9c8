"""What an inertial estimation returns, and how it reads as JSON."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contract import central_differences
from tactile_dynamics_ros.core.numerics.regime import split_label
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    com_inertia_jacobian,
    inertia_matrix,
)

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


PARAMETER_NAMES = (
    "mass",
    "com_x",
    "com_y",
    "com_z",
    "inertia_xx",
    "inertia_xy",
    "inertia_yy",
    "inertia_xz",
    "inertia_yz",
    "inertia_zz",
)
"""Names of the ten numbers of a body in documents and on topics: kg, m in the body frame, kg m^2
about the centre of mass; the matrix column by column, as in `inertia_vector`. They are API: scripts
and `/diagnostics` use them. Another order would name a moment by a product; another name breaks
what reads them."""


def describe_parameter(name: str) -> str:
    """Return one of PARAMETER_NAMES in words.

    >>> describe_parameter("inertia_xx"), describe_parameter("com_y")
    ('inertia about x', 'centre of mass along y')
    """
    kind, _, axes = name.partition("_")
    if kind == "mass":
        return "mass"
    if kind == "com":
        return f"centre of mass along {axes}"
    return f"inertia about {axes[0]}" if axes[0] == axes[1] else f"product of inertia {axes}"


_STEP = 1e-4
"""Step of central differences of the load after an event, in shares of each parameter: products of
three of them, so that the error is 1e-8. Larger bends, smaller rounds."""


@dataclass(frozen=True)
class EffectEstimate:
    """Parameters of one effect: value, standard deviation and unit by name."""

    value: dict[str, float]
    std: dict[str, float]
    unit: dict[str, str]

    def to_json(self) -> dict[str, dict[str, Any]]:
        """{parameter: {"value", "std", "unit"}}."""
        return {
            name: {"value": self.value[name], "std": self.std[name], "unit": self.unit[name]}
            for name in self.value
        }


@dataclass(frozen=True)
class ModelError:
    """How far the model is from the measurements.

    Attributes:
        force_rms_n: N, measured minus predicted net force with smoothed motion.
        torque_rms_nm: N m, likewise.
        whitened_rms: 1 where only the stated sensor noise remains.
    """

    force_rms_n: float
    torque_rms_nm: float
    whitened_rms: float

    def to_json(self) -> dict[str, float]:
        """Field by field."""
        return dict(vars(self))


@dataclass(frozen=True)
class LoadEvent:
    """Something that changed at one time, and the load after it.

    Attributes:
        name: of the effect, without its time.
        time: s from the start of the recording.
        std: of the time, s; None where it was given.
        load: dynamic parameters (10,) after it; None where the load stays.
        covariance: (10, 10) of them.
    """

    name: str
    time: float
    std: float | None
    load: Array | None
    covariance: Array

    @classmethod
    def of(
        cls, effect: Effect, phi: Array, theta: Array, covariance: Array, std: float | None
    ) -> LoadEvent:
        """An event as it is fitted.

        Args:
            effect: the event, from its time on.
            phi: (10,) load before it.
            theta: (k,) parameters.
            covariance: (10 + k, 10 + k) of both.
            std: s, of the time; None where it was given.
        """
        name, regime = split_label(effect.name)
        assert regime is not None
        time, load = regime.gates[0].low, effect.load_after(phi, theta)
        if load is None:
            return cls(name, time, std, None, np.zeros((10, 10)))
        both = np.append(phi, theta)
        change = central_differences(
            lambda at: np.asarray(effect.load_after(at[:10], at[10:])),
            both,
            _STEP * np.maximum(np.abs(both), _STEP),
        )
        return cls(name, time, std, load, change @ covariance @ change.T)

    @property
    def body(self) -> InertialParameters | None:
        """The body after it."""
        return None if self.load is None else InertialParameters.from_dynamic_parameters(self.load)

    @property
    def parameter_std(self) -> Array:
        """(10,) standard deviations in the order of PARAMETER_NAMES."""
        assert self.load is not None
        return np.sqrt(np.diag(_about_centre(self.load, self.covariance)))

    def to_json(self) -> dict[str, Any]:
        """{"name", "t", "std", "after"}; the body after it is None where it stays."""
        entry: dict[str, Any] = {"name": self.name, "t": self.time, "std": self.std, "after": None}
        if self.body is not None:
            entry["after"] = _body_json(self.body, self.parameter_std)
        return entry


def _about_centre(phi: Array, covariance: Array) -> Array:
    """(10, 10) of mass, centre of mass and inertia about it, from the covariance of phi."""
    jacobian = com_inertia_jacobian(phi)
    return np.asarray(jacobian @ covariance @ jacobian.T)


def _body_json(body: InertialParameters, std: Array) -> dict[str, Any]:
    """Mass, centre of mass and inertia about it, each with its standard deviation."""
    return {
        "mass": {"value": body.mass, "std": float(std[0])},
        "com": {"value": body.com.tolist(), "std": std[1:4].tolist()},
        "inertia_com": {
            "value": body.inertia_com.tolist(),
            "std": inertia_matrix(std[4:]).tolist(),
        },
    }


@dataclass(frozen=True)
class InertialEstimate:
    """Mass, centre of mass and inertia of the held object with their uncertainty.

    Attributes:
        inertia: the estimate; a body that can exist.
        covariance: (10, 10) covariance of phi = `inertia.dynamic_parameters`.
        effects: estimated parameters of the added effects by effect name.
        error: remaining model error.
        not_excited: parameters (of PARAMETER_NAMES) that the motion did not determine.
        samples: number of wrench samples used.
        duration: s covered.
        converged: whether the iteration converged.
        lasting: (10, 10) part of the covariance that lasting errors of the sensors make, such as
            their gains; None where it is not known by itself.
        event: what changed at one time, with the load after it; None where nothing did.
    """

    inertia: InertialParameters
    covariance: Array
    effects: dict[str, EffectEstimate]
    error: ModelError
    not_excited: tuple[str, ...]
    samples: int
    duration: float
    converged: bool
    lasting: Array | None = field(default=None, kw_only=True)
    event: LoadEvent | None = field(default=None, kw_only=True)

    @property
    def parameter_covariance(self) -> Array:
        """(10, 10) covariance of [mass, com, inertia about the centre of mass]."""
        return _about_centre(self.inertia.dynamic_parameters, self.covariance)

    @property
    def parameter_std(self) -> Array:
        """(10,) standard deviations in the order of PARAMETER_NAMES."""
        return np.sqrt(np.diag(self.parameter_covariance))

    def to_json(self) -> dict[str, Any]:
        """The document that `tactile-dynamics estimate --json` prints."""
        body = self.inertia
        return {
            "samples": self.samples,
            "duration_s": self.duration,
            **_body_json(body, self.parameter_std),
            "pseudo_inertia_eigenvalues": np.linalg.eigvalsh(body.pseudo_inertia).tolist(),
            "dynamic_parameters": {
                "value": body.dynamic_parameters.tolist(),
                "covariance": self.covariance.tolist(),
            },
            "effects": {name: effect.to_json() for name, effect in self.effects.items()},
            "event": None if self.event is None else self.event.to_json(),
            "error": self.error.to_json(),
            "undetermined": list(self.not_excited),
            "converged": self.converged,
        }
