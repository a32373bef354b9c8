"""An arm as it was fitted: friction, bodies, gains, and how well they are known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.least_squares import LeastSquaresModel
from tactile_dynamics_ros.core.joints.drive_effects import TorqueGain
from tactile_dynamics_ros.core.joints.effects import JointEffect
from tactile_dynamics_ros.core.joints.prior import Basis, dispersion
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.joints.situation import Situation
from tactile_dynamics_ros.core.numerics.banded import BandedWhitener


@dataclass(frozen=True, eq=False)
class FittedArm(LeastSquaresModel[JointEffect]):
    """Mean joint torques of blocks: rigid bodies, plain friction, effects.

    tau = Y phi + F sign(q') + B q' + o + sum of effects; phi of links and payload by the URDF's
    prior. Own parameters are [F, B, o of each joint, z].

    Attributes:
        samples: what was measured.
        basis: of the bodies' parameters.
        parts: own parameters.
        effects: of the model. theta: their parameters.
        catalogue: names of the effects that may be tried.
        effort_std: (n,) noise of a block's mean torque, N m.
        whitening: of the rows.
        situation: that effects act on.
        misfit: factor on the squares of the noise that a misfit is, 1 for none: priors of bodies
            and of gains count so much more against a residual that is correlated.
    """

    samples: JointSamples
    basis: Basis
    parts: Array
    effects: tuple[JointEffect, ...]
    theta: tuple[Array, ...]
    catalogue: tuple[str, ...]
    effort_std: Array
    whitening: BandedWhitener
    situation: Situation
    misfit: float = 1.0

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.samples.arm.names

    @property
    def friction(self) -> Array:
        """(3, n) Coulomb friction, viscous friction, offset."""
        return self.parts[: 3 * len(self.joints)].reshape(3, -1)

    @cached_property
    def bodies(self) -> Array:
        """(P,) dynamic parameters of links and payload, links in their own frames."""
        return self.basis.mean + self.basis.back @ self.parts[3 * len(self.joints) :]

    @property
    def scale_std(self) -> float:
        """Std of the logarithm of all torques' common scale, unless a payload was weighed."""
        std = self.samples.gain_std
        return 0.0 if std is None or self.basis.mean[-10] > 0.0 else float(std.min())

    @property
    def drive_gains(self) -> Array:
        """(n,) how much each torque reads over what it is, by the effect of gains; 1 without."""
        found = np.ones(len(self.joints))
        for effect, theta in zip(self.effects, self.theta, strict=True):
            if isinstance(effect, TorqueGain):
                found[list(effect.which)] += theta
        return found

    @property
    def link_bodies(self) -> Array:
        """(n, 10) dynamic parameters of the links in their own frames."""
        return self.bodies[:-10].reshape(-1, 10)

    @property
    def payload(self) -> Array:
        """(10,) dynamic parameters of the payload in the last link's frame."""
        return np.asarray(self.samples.arm.to_last_link @ self.bodies[-10:])

    def bodies_covariance(self) -> Array:
        """(P, P) of `bodies`, widened by the misfit; the prior's where nothing is told."""
        first, kept, root = 3 * len(self.joints), self.basis.kept, self.basis.root
        last = len(self.parts)
        told = self.covariance[first:last, first:last]
        whole = np.eye(len(root)) - kept @ kept.T + kept @ told @ kept.T
        return np.asarray(root @ whole @ root.T)

    @property
    def covariance(self) -> Array:
        """(p, p) of all parameters, widened by the misfit and by how far it is correlated."""
        whole = self.evaluated[1]
        return np.asarray(self.dispersion * np.linalg.inv(whole.T @ whole))

    @cached_property
    def dispersion(self) -> float:
        """Factor on variances: mean square of the residual times its correlation time."""
        return dispersion(self.residual.reshape(-1, len(self.joints)), self.samples.length)
