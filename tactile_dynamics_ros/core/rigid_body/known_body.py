"""A body that is known beforehand: a tool from its data sheet, an object from an earlier grasp."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KnownBody:
    """Dynamic parameters with their covariance, in the body frame of the recordings.

    Attributes:
        phi: (10,) dynamic parameters.
        covariance: (10, 10) of phi; zero where it is not known.
        name: where it comes from.
        undetermined: parameters that nothing has told yet.
        effects: effects that were found with it: name to parameters with value, std and unit.
        recordings: number of recordings that it comes from.
        lasting: (10, 10) part of the covariance that lasting errors of the sensors make; None where
            it is not known by itself.
    """

    phi: Array
    covariance: Array
    name: str
    undetermined: tuple[str, ...] = ()
    effects: dict[str, Any] = field(default_factory=dict)
    recordings: int = 0
    lasting: Array | None = None

    @classmethod
    def exact(cls, body: InertialParameters, name: str) -> KnownBody:
        """A body whose uncertainty is not stated."""
        return cls(body.dynamic_parameters, np.zeros((10, 10)), name)

    @property
    def is_exact(self) -> bool:
        """Whether no uncertainty is stated."""
        return not self.covariance.any()
