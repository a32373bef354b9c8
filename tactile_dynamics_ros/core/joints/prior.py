"""What is presumed of an arm: bodies by its URDF, how far it may be off, and noise of torques."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, lapack

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.numerics.banded import VARIANCE_FLOOR, BandedWhitener
from tactile_dynamics_ros.core.numerics.noise import white_noise_std
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
)

SHARES = (0.1, 0.2, 0.4)
"""How far the bodies of a URDF may be off, as a relative std, from which the recording chooses:
files made from CAD are within 10 %, those guessed from the outside within 40 %. Lower ones would be
chosen where something else is missing, and then hold what bodies cannot explain against effects."""
USUAL_SHARE = 0.1
"""The share that is taken until a recording says otherwise."""
_LOAD_SHARE = 0.3
"""Prior std of a payload's mass over that of all moving links: arms carry up to a third of their
moving mass. Wider ones tell less where the arm does not."""
_LOAD_RADIUS = 0.15
"""Prior std of a payload's centre from the flange, m: grippers and boxes reach as far. It holds
the directions that a recording does not tell."""
_HARDLY = 1e-3
"""How far bodies may be off where torques seem to be in other units; 0 would have no root."""
_WEIGHED = 0.002
"""Share to which a weighed payload is known: that of a kitchen scale."""
_TOLD = 0.02
"""Information of a recording on a direction of the bodies' parameters, over that of the prior, from
which the model has a parameter for it: below, data move it by a hundredth of its prior std."""
FRICTION_STD = 100.0
"""Prior std of Coulomb and viscous friction and of an offset, N m, N m s/rad and N m: nothing is
known of them. Less would pull them to zero on large arms."""
_SMALLEST = 1e-4
"""Share of a body's size that its thinnest direction has at least: points and rods in a URDF are
bodies of some width."""
_NO_BODY = 1e-6
"""Mass below which a URDF says nothing of a link, kg."""
_UNKNOWN_MASS, _UNKNOWN_RADIUS = 2.0, 0.1
"""Prior std of the mass, kg, and size, m, of a link of which a URDF says nothing: those of a link
of a table-top arm."""
_AT_REVERSAL = 0.5
"""Std of the friction in a block in which a joint turns back, over its Coulomb friction: a law of
sliding says nothing there, where presliding goes from one sign to the other. With 0 reversals count
as much as other blocks, which no real drive bears; with 1 they count for nothing."""
_LEAST_NOISE = 1e-6
"""Noise of a mean torque at least, N m: data without any noise stay finite."""
_CORRELATED = 1.0
"""Time over which correlation of residuals is looked for, s: errors of a model follow motions,
whose strokes last as long."""
_APART = 3
"""Blocks from which accelerations share no sample: windows are three blocks long."""


@dataclass(frozen=True, eq=False)
class BodyPrior:
    """Prior N(mean, root root^T) of the dynamic parameters of n links and of a payload.

    Attributes:
        mean: (10 n + 10,); the payload's are zero, in the flange's frame.
        links: (10 n, 10 n) root of the links' covariance for a share of 1.
        load: (10, 10) root of the payload's covariance.
        stated: (n,) whether the URDF says anything of a link.
    """

    mean: Array
    links: Array
    load: Array
    stated: NDArray[np.bool_]

    @classmethod
    def of(cls, arm: Arm, known_load: float | None = None) -> BodyPrior:
        """Prior of an arm's URDF.

        Args:
            arm: with the URDF's bodies.
            known_load: mass of the payload, kg, if it was weighed.
        """
        stated = arm.inertia[:, 0] > _NO_BODY
        roots = [
            _root(pseudo_inertia(phi)) if known else _unknown()
            for phi, known in zip(arm.inertia, stated, strict=True)
        ]
        mean = np.append(arm.inertia.reshape(-1), np.zeros(10))
        moving = float(arm.inertia[:, 0].sum())
        mass = _LOAD_SHARE * (moving or _UNKNOWN_MASS * len(stated))
        radius = _LOAD_RADIUS
        load = np.diag([mass] + [mass * radius] * 3 + [mass * radius**2] * 6)
        if known_load is not None:
            mean[-10], load[0, 0] = known_load, _WEIGHED * known_load
        return cls(mean, block_diag(*roots), load, stated)

    def as_stated(self) -> BodyPrior:
        """The same arm as its URDF says, without a payload.

        Where torques seem to be in other units, no body may make up for them.
        """
        return replace(self, links=_HARDLY * self.links, load=_HARDLY * self.load)

    def root(self, share: float) -> Array:
        """Root (P, P) of the covariance where the URDF is off by a share."""
        return np.asarray(block_diag(share * self.links, self.load))


def _root(matrix: Array) -> Array:
    """Root (10, 10) of the covariance of a body whose every dimension may be off by 100 %.

    P = L L^T becomes L (1 + E) L^T with E symmetric: to first order these are the bodies at a
    Riemannian distance |E| from it, whatever its size and frame.

    Source: Lee, Wensing, Park 2020 (constant pullback of the affine-invariant metric).
    """
    size = np.trace(matrix)
    factor = np.linalg.cholesky(matrix + _SMALLEST * size * np.eye(4))
    columns = []
    for i in range(4):
        for j in range(i + 1):
            change = np.zeros((4, 4))
            change[i, j] = change[j, i] = 1.0 if i == j else 1.0 / np.sqrt(2.0)
            columns.append(dynamic_parameters_from_pseudo_inertia(factor @ change @ factor.T))
    return np.stack(columns, axis=1)


def _unknown() -> Array:
    mass, radius = _UNKNOWN_MASS / USUAL_SHARE, _UNKNOWN_RADIUS
    return np.diag([mass] + [mass * radius] * 3 + [mass * radius**2] * 6)


@dataclass(frozen=True, eq=False)
class Basis:
    """What a recording lets be told of bodies: tau = start + columns [friction, z].

    Attributes:
        start: (M,) torques of the URDF's bodies, N m.
        columns: (M, 3 n + q) torques per friction parameter and per direction z.
        back: (P, q) parameters of bodies per direction z, prior N(0, 1).
        mean: (P,) parameters of the bodies where z = 0.
        root: (P, P) of the prior's covariance.
        kept: (P, q) orthonormal directions z in units of the prior.
        share: how far the URDF's bodies may be off.
    """

    start: Array
    columns: Array
    back: Array
    mean: Array
    root: Array
    kept: Array
    share: float


def all_columns(samples: JointSamples) -> tuple[Array, Array]:
    """Columns (M, 3 n) of friction and (M, P) of bodies."""
    count, n = samples.effort.shape
    shapes = [samples.direction.mean(axis=1), samples.dq.mean(axis=1), np.ones((count, n))]
    friction = np.concatenate([one[:, :, None] * np.eye(n) for one in shapes], axis=2)
    links = samples.regressor
    load = links[:, :, -10:] @ samples.arm.to_last_link
    load = load * samples.loaded[:, None, None]
    bodies = np.concatenate([links, load], axis=2)
    return friction.reshape(count * n, -1), bodies.reshape(count * n, -1)


def basis_of(
    samples: JointSamples, prior: BodyPrior, share: float, whitening: BandedWhitener
) -> Basis:
    """Directions of the bodies' parameters that a recording tells.

    Args:
        samples: blocks.
        prior: of the bodies.
        share: how far the URDF's may be off.
        whitening: of the rows.
    """
    friction, bodies = all_columns(samples)
    root = prior.root(share)
    felt = bodies @ root
    white = whitening.whiten(felt)
    values, vectors = np.linalg.eigh(white.T @ white)
    kept = vectors[:, values > _TOLD]
    columns = np.concatenate([friction, felt @ kept], axis=1)
    return Basis(bodies @ prior.mean, columns, root @ kept, prior.mean, root, kept, share)


def likeliest_share(
    prior: BodyPrior, others: tuple[Array, Array], bodies: Array, residual: Array, dispersion: float
) -> float:
    """How far a URDF's bodies are off: RMS of `SHARES`, weighted by the evidence of a recording.

    -2 log p = r^T r - b^T (G + P)^-1 b + ln det(G + P) - ln det P of all columns, with G and b
    their products with themselves and with r, and P the prior's precision.

    Args:
        prior: of the bodies.
        others: white columns (M, o) of friction and effects, and their prior stds (o,).
        bodies: (M, P) white columns.
        residual: (M,) white residual where bodies are as in the URDF and the others are zero.
        dispersion: by which squares count less than those of white noise.

    Source: MacKay 1992 (evidence); Schwarz 1978; Hoeting et al. 1999 (model averaging).
    """
    columns, stds = others
    matrix, first = np.concatenate([columns, bodies], axis=1), len(stds)
    gram, side = matrix.T @ matrix / dispersion, matrix.T @ residual / dispersion
    gram[:first, :first] += np.diag(1.0 / stds**2)

    def minus_twice_log(share: float) -> float:
        inverse = np.linalg.inv(prior.root(share))
        total = gram.copy()
        total[first:, first:] += inverse.T @ inverse
        scale = 1.0 / np.sqrt(np.diag(total))
        scaled = total * np.outer(scale, scale)
        determinant = float(np.linalg.slogdet(scaled)[1]) - 2.0 * float(np.sum(np.log(scale)))
        fall = float((side * scale) @ np.linalg.solve(scaled, side * scale))
        of_prior = 2.0 * len(prior.links) * float(np.log(share))
        return -fall + determinant + of_prior

    shares = np.array(SHARES)
    minus_twice = np.array([minus_twice_log(share) for share in SHARES])
    weights = np.exp(-0.5 * (minus_twice - minus_twice.min()))
    return float(np.sqrt(np.sum(weights * shares**2) / weights.sum()))


def whitener(samples: JointSamples, effort_std: Array, friction: Array) -> BandedWhitener:
    """Whitener of rows (K n, ...), block by block, joint fastest.

    C_kl = M_k diag(s_q^2) M_l^T c_|k-l| + diag(s_tau^2 + (turning F / 2)^2) [k = l].

    Args:
        samples: blocks.
        effort_std: (n,) s_tau of a block's mean torque.
        friction: (n,) Coulomb friction F.

    Raises:
        NotIdentifiableError: the noise cannot be whitened.
    """
    count, n = samples.effort.shape
    band = np.zeros((_APART * n, count * n))
    carried = samples.mass_matrix * samples.position_std
    linked = np.ones(count, dtype=bool)
    for apart in range(_APART):
        later = carried[apart:] @ np.swapaxes(carried[: count - apart], 1, 2)
        later = later * samples.lags[apart]
        if apart:
            linked = linked[: count - apart] & samples.follows[apart - 1 :]
            later = later * linked[:, None, None]
        _put(band, later, apart, n)
    own = effort_std**2 + (_AT_REVERSAL * samples.turning * friction) ** 2
    band[0] += own.reshape(-1) + VARIANCE_FLOOR
    factor, info = lapack.dpbtrf(band, lower=1)
    if info != 0:
        raise NotIdentifiableError(
            f"joints: the noise cannot be whitened (row {info}); check the stamps of the recording"
        )
    return BandedWhitener(factor)


def _put(band: Array, blocks: Array, apart: int, n: int) -> None:
    """Put blocks (K', n, n) of rows `apart` blocks below their columns into lower band storage."""
    columns = np.arange(len(blocks)) * n
    for i in range(n):
        for j in range(n):
            below = apart * n + i - j
            if below >= 0:
                band[below, columns + j] = blocks[:, i, j]


def stated_noise(samples: JointSamples) -> Array:
    """(n,) noise of mean torques by the white noise of their samples, N m."""
    return np.asarray(np.maximum(samples.effort_std, _LEAST_NOISE))


def seen_noise(samples: JointSamples, effort_std: Array, white: Array) -> Array:
    """(n,) noise of torques at which what changes from block to block has a variance of 1.

    What a model misses follows the motion or jumps at reversals: differences of high order and
    their median see little of it, whatever it is, so that models with more effects are held against
    the same noise.

    Args:
        samples: blocks.
        effort_std: (n,) by which the residual was made white.
        white: (K, n) residual.
    """
    seen = np.array([white_noise_std(samples.time, one[:, None]) for one in white.T])
    return np.asarray(np.maximum(effort_std * seen, 0.5 * stated_noise(samples)))


def dispersion(white: Array, length: float) -> float:
    """Factor on variances: mean square of a residual (K, n), 1 at least, times its correlation.

    1 + 2 sum of the correlations of blocks up to a second apart, as far as they are significant.

    Args:
        white: (K, n).
        length: of a block, s.
    """
    centred = white - white.mean(axis=0)
    power, total = float(np.sum(centred**2)), 1.0
    for apart in range(1, min(round(_CORRELATED / length), len(white) // 4)):
        correlation = float(np.sum(centred[apart:] * centred[:-apart])) / max(power, 1e-300)
        if correlation <= 2.0 / np.sqrt(white.size):
            break
        total += 2.0 * correlation
    return max(1.0, float(np.mean(white**2))) * total
