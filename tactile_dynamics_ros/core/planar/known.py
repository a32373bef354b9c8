"""A pushed object that is known beforehand, from earlier recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array

KNOWN_NAMES = ("ln_friction_force", "ln_mass", "com_x", "com_y")
"""What is remembered, in the order of covariances of estimates; files have these names, so that
another order reads old files wrongly."""


@dataclass(frozen=True, eq=False)
class KnownPushed:
    """Four numbers of an object on a support, in its frame.

    Attributes:
        values: (4,) of KNOWN_NAMES: ln N, ln kg, m, m.
        covariance: (4, 4) of them.
        name: where it comes from.
        undetermined: names of an estimate that nothing has told yet.
        recordings: number of recordings that it comes from.
    """

    values: Array
    covariance: Array
    name: str
    undetermined: tuple[str, ...] = ()
    recordings: int = 1

    def beforehand(self, usual: float, spread: float) -> tuple[Array, Array]:
        """What a fit may begin with: the values (4,) and a root (k, 4) of their information.

        A mass that nothing has told is that of the usual friction, wherever the fit has left it.

        Args:
            usual: friction force over mass, N/kg.
            spread: standard deviation of its logarithm.
        """
        mean = self.values.copy()
        if "mass" not in self.undetermined:
            return mean, np.linalg.cholesky(np.linalg.inv(self.covariance)).T
        mean[1] = mean[0] - np.log(usual)
        told, root = [0, 2, 3], np.zeros((4, 4))
        information = np.linalg.inv(self.covariance[np.ix_(told, told)])
        root[:3, told] = np.linalg.cholesky(information).T
        root[3, :2] = 1.0 / spread, -1.0 / spread
        return mean, root
