"""A recording of joints in short blocks: motion inside each, mean torque, and what noise it has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.joints.arm import Arm, Motion
from tactile_dynamics_ros.core.numerics.local_polynomial import typical_period
from tactile_dynamics_ros.core.numerics.noise import white_noise_std
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams

BLOCK = 0.04
"""Length of a block, s: 25 blocks a second, so that torques that follow a motion of up to 2 Hz and
its harmonics are seen, while means of 20 samples at 500 Hz have a fifth of their noise. Longer ones
blur reversals, shorter ones cost time and let noise of accelerations through."""
_FEWEST_SAMPLES = 4
"""Samples of a block at least: three blocks must hold a polynomial of degree 5 with something to
spare. At 50 Hz a block then lasts 0.08 s."""
_MOST_BLOCKS = 4000
"""Blocks of a recording at most; those of longer recordings last longer, up to four times, and
beyond that (eleven minutes at 500 Hz) only the first are used. 4000 of 0.04 s are 160 s; more cost
time in proportion."""
_DEGREE = 5
"""Degree of the polynomial over three blocks: for sines of 2 Hz over 0.12 s the error of an
acceleration is below 0.1 %; degree 3 leaves 2 %, 7 doubles its noise."""
_GAP = 3.5
"""Step over the usual one from which nothing is interpolated: three lost messages make 4."""
_NODES = np.sqrt(3.0 / 5.0) * np.array([-1.0, 0.0, 1.0])
"""Places in a block, in halves of its length, at which rigid bodies are evaluated: Gauss' three
points integrate polynomials of degree 5 exactly."""
_NODE_SHARES = np.array([5.0, 8.0, 5.0]) / 18.0
"""Shares of these places in the mean; Gauss' weights."""
_FEWEST_BLOCKS = 50
"""Blocks of a recording at least, two seconds: fewer hold less than the parameters of one joint."""
_PAUSE = 10.0
"""Pause that is put between recordings that are joined, s: longer than the windows of any test, so
that nothing looks as if it went on from one to the next."""
_STILL = 5.0
"""Speed, in standard deviations of its noise, below which a joint's direction fades to none. Lower
takes noise for motion at standstill; higher loses slow motion."""
_LEAST_SPEED = 1e-4
"""The same speed at least, rad/s or m/s: below it friction of any drive is stiction and no law of
sliding holds."""


@dataclass(frozen=True, eq=False)
class JointSamples:
    """Blocks of B samples of the motion of n joints.

    Attributes:
        arm: whose joints these are.
        time: (K,) middle of each block, s from the first sample.
        length: of a block, s.
        t: (K, B) of the samples. q, dq, ddq: (K, B, n) smoothed motion.
        nodes: (3, K, 3, n) the same motion at the three places of `_NODES`.
        effort: (K, n) mean torque of each block.
        effort_std: (n,) of a block's mean, from the white noise of its samples.
        position_std: (n,) of the encoders' noise.
        lags: (3,) covariance of mean accelerations of blocks 0, 1 and 2 apart, for unit noise.
        follows: (K - 1,) whether a block follows the one before at once.
        speed_std: standard deviation of a speed for unit noise of positions.
        lead: (2, B, n) position and speed in the block before the first.
        loaded: (K,) whether the arm carried the payload then.
        gain_std: (n,) std of the logarithm of a factor by which torques may be off N m; None where
            they are N m.
        gain_taken: (n,) logarithm of the factors that have been taken out of torques since.
    """

    arm: Arm
    time: Array
    length: float
    t: Array
    q: Array
    dq: Array
    ddq: Array
    nodes: Array
    effort: Array
    effort_std: Array
    position_std: Array
    lags: Array
    follows: NDArray[np.bool_]
    speed_std: float
    lead: Array
    loaded: NDArray[np.bool_]
    gain_std: Array | None = None
    gain_taken: Array | float = 0.0

    @classmethod
    def from_streams(cls, streams: JointStreams, arm: Arm) -> JointSamples:
        """Cut a recording into blocks.

        Args:
            streams: of the arm's joints, at least.
            arm: whose joints are looked at.

        Raises:
            NotIdentifiableError: it is too short or too full of gaps.
        """
        own = streams.of(arm.names)
        sound = np.isfinite(own.position).all(axis=1) & np.isfinite(own.effort).all(axis=1)
        sound &= np.append(True, np.diff(own.time) > 0.0)
        time, position, effort = own.time[sound], own.position[sound], own.effort[sound]
        if len(time) < 3 * _FEWEST_SAMPLES:
            raise NotIdentifiableError(f"joints: {len(time)} samples; record some seconds")
        period = typical_period(time)
        count = max(_FEWEST_SAMPLES, round(BLOCK / period))
        count = min(4 * count, max(count, len(time) // _MOST_BLOCKS))
        starts = _block_starts(time, count, _GAP * period)[:_MOST_BLOCKS]
        if len(starts) < _FEWEST_BLOCKS:
            raise NotIdentifiableError(
                f"joints: {len(starts)} blocks of {count * period:.2f} s without a gap; expected "
                f"{_FEWEST_BLOCKS} at least: record some seconds of motion"
            )
        found = cls.of_blocks(arm, (time, position, effort), starts, count, period)
        return replace(found, gain_std=own.gain_std)

    @classmethod
    def of_blocks(
        cls,
        arm: Arm,
        signals: tuple[Array, Array, Array],
        starts: NDArray[np.intp],
        count: int,
        period: float,
    ) -> JointSamples:
        """Blocks that begin at known samples, each between two others.

        Args:
            arm: whose joints these are.
            signals: stamps (N,) s, positions (N, n) and torques (N, n).
            starts: (K,) first sample of each block.
            count: samples of a block.
            period: of the samples, s.
        """
        time, position, effort = signals
        length, n = count * period, len(arm.names)
        inside = starts[:, None] + np.arange(count)
        around = starts[:, None] + np.arange(-count, 2 * count)
        middle = time[inside].mean(axis=1)
        found = _polynomials(time[around] - middle[:, None], position[around], 1.5 * length)
        half = 0.5 * length * float(np.sqrt(1.0 - 1.0 / count**2))
        even = np.asarray((np.arange(-count, 2 * count) - 0.5 * (count - 1)) * period)
        lags, speed_std = _noise_of_motion(even, count, 1.5 * length)
        white = [white_noise_std(time, one[:, None]) for one in (*effort.T, *position.T)]
        q, dq, ddq = _evaluate(found, time[inside] - middle[:, None], 1.5 * length)
        before = time[starts[0] - count : starts[0]] - middle[0]
        return cls(
            arm=arm,
            time=middle - time[0],
            length=length,
            t=time[inside] - time[0],
            q=q,
            dq=dq,
            ddq=ddq,
            nodes=_evaluate(found, np.tile(half * _NODES, (len(middle), 1)), 1.5 * length),
            effort=effort[inside].mean(axis=1),
            effort_std=np.array(white[:n]) / np.sqrt(count),
            position_std=np.array(white[n:]),
            lags=lags,
            follows=np.diff(starts) == count,
            speed_std=speed_std,
            lead=_evaluate(found[:1], before[None], 1.5 * length)[:2, 0],
            loaded=np.ones(len(middle), dtype=bool),
        )

    @classmethod
    def join(cls, parts: Sequence[JointSamples]) -> JointSamples:
        """Several recordings of one arm, one after the other; blocks of one length.

        Raises:
            BadInputError: they are not of the same joints, or at different rates.
        """
        first = parts[0]
        if len(parts) == 1:
            return first
        if any(p.arm.names != first.arm.names or p.t.shape[1] != first.t.shape[1] for p in parts):
            raise BadInputError(
                "joints: recordings of different joints or rates; expected several of one arm at "
                "one rate"
            )
        starts = np.cumsum([0.0, *(p.time[-1] + _PAUSE for p in parts[:-1])])
        follows = [np.append(p.follows, False) for p in parts]

        def joined(name: str) -> Array:
            return np.concatenate([getattr(p, name) for p in parts])

        return replace(
            first,
            time=np.concatenate([p.time + s for p, s in zip(parts, starts, strict=True)]),
            t=np.concatenate([p.t + s for p, s in zip(parts, starts, strict=True)]),
            q=joined("q"),
            dq=joined("dq"),
            ddq=joined("ddq"),
            effort=joined("effort"),
            loaded=np.concatenate([p.loaded for p in parts]),
            nodes=np.concatenate([p.nodes for p in parts], axis=1),
            follows=np.concatenate(follows)[:-1],
            gain_std=next((p.gain_std for p in parts if p.gain_std is not None), None),
            effort_std=np.sqrt(np.mean([p.effort_std**2 for p in parts], axis=0)),
            position_std=np.sqrt(np.mean([p.position_std**2 for p in parts], axis=0)),
        )

    def scaled(self, factors: Array) -> JointSamples:
        """Torques times a factor for each joint (n,)."""
        return replace(
            self, effort=self.effort * factors, effort_std=self.effort_std * np.abs(factors)
        )

    def without_gains(self, gains: Array) -> JointSamples:
        """Torques over gains (n,) that a fit found, which count as found from now on."""
        taken = self.gain_taken + np.log(gains)
        return replace(self.scaled(1.0 / gains), gain_taken=taken)

    @property
    def middle(self) -> Array:
        """(3, K, n) position, speed and acceleration in the middle of each block."""
        return self.nodes[:, :, 1]

    @cached_property
    def motions(self) -> list[Motion]:
        """Motion of all links at each of the three places of a block."""
        return [self.arm.motion(*self.nodes[:, :, k]) for k in range(3)]

    @cached_property
    def mass_matrix(self) -> Array:
        """(K, n, n) of the URDF's bodies in the middle of each block."""
        return self.arm.mass_matrix(self.motions[1], self.arm.inertia)

    @cached_property
    def regressor(self) -> Array:
        """(K, n, 10 n) of the mean torque of each block."""
        parts = [self.arm.regressor(motion) for motion in self.motions]
        return np.asarray(sum(s * p for s, p in zip(_NODE_SHARES, parts, strict=True)))

    def within(self, at_nodes: Array, at: Array) -> Array:
        """Values (K, P, n) at places in a block, by a parabola through those at `_NODES`."""
        a = _NODES[2]
        weights = np.stack(
            [at * (at - a) / (2.0 * a**2), 1.0 - (at / a) ** 2, at * (at + a) / (2.0 * a**2)]
        )
        return np.asarray(np.einsum("sp,ksn->kpn", weights, at_nodes))

    @cached_property
    def places(self) -> Array:
        """(B,) places of the samples in a block, in units in which `_NODES` are."""
        count = self.t.shape[1]
        return np.asarray((2.0 * np.arange(count) - (count - 1)) / np.sqrt(count**2 - 1.0))

    @cached_property
    def direction(self) -> Array:
        """(K, B, n) sign of the speed; it fades to zero at standstill."""
        least = np.maximum(_STILL * self.speed_std * self.position_std, _LEAST_SPEED)
        return np.asarray(np.tanh(self.dq / least))

    @cached_property
    def turning(self) -> Array:
        """(K, n) share of each block in which a joint turns back or stands: 0 where it moves on."""
        return np.asarray(1.0 - np.abs(self.direction.mean(axis=1)))

    @cached_property
    def since_reversal(self) -> Array:
        """(K, B, n) distance travelled since the last change of direction, rad; infinite before."""
        count, size, n = self.q.shape
        q = np.concatenate([self.lead[0], self.q.reshape(-1, n)])
        sign = np.sign(np.concatenate([self.lead[1], self.dq.reshape(-1, n)]))
        found = np.full(q.shape, np.inf)
        for j in range(n):
            turns = np.flatnonzero(sign[1:, j] * sign[:-1, j] < 0.0) + 1
            if len(turns):
                last = np.searchsorted(turns, np.arange(len(q)), side="right") - 1
                known = last >= 0
                found[known, j] = np.abs(q[known, j] - q[turns[last[known]], j])
        return found[size:].reshape(count, size, n)


def _block_starts(time: Array, count: int, gap: float) -> NDArray[np.intp]:
    """First sample of each block whose two neighbours are whole as well."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(time) > gap) + 1, [len(time)]])
    parts = [
        np.arange(first + count, last - 2 * count + 1, count)
        for first, last in zip(edges[:-1], edges[1:], strict=True)
    ]
    return np.concatenate([np.asarray(part, dtype=np.intp) for part in parts])


def _powers(offsets: Array, scale: float) -> Array:
    return (offsets / scale)[..., None] ** np.arange(_DEGREE + 1)


def _polynomials(offsets: Array, values: Array, scale: float) -> Array:
    """Coefficients (K, d, n) of polynomials through (K, W, n), powers of offset over scale."""
    basis = _powers(offsets, scale)
    transposed = np.swapaxes(basis, 1, 2)
    return np.asarray(np.linalg.solve(transposed @ basis, transposed @ values))


def _evaluate(coefficients: Array, offsets: Array, scale: float) -> Array:
    """Value and two derivatives (3, K, P, n) at offsets (K, P)."""
    found, steps = [], coefficients
    for _ in range(3):
        powers = _powers(offsets, scale)[..., : steps.shape[1]]
        found.append(powers @ steps)
        steps = steps[:, 1:] * (np.arange(1, steps.shape[1]) / scale)[:, None]
    return np.stack(found)


def _noise_of_motion(even: Array, count: int, scale: float) -> tuple[Array, float]:
    """Covariances (3,) of mean accelerations of blocks, std of a speed, for unit noise."""
    weights = _polynomials(even[None], np.eye(len(even))[None], scale)
    inside = even[None, count : 2 * count]
    _, speed, rate = _evaluate(weights, inside, scale)[:, 0].mean(axis=1)
    shifted = [rate[k * count :] @ rate[: len(rate) - k * count] for k in range(3)]
    return np.array(shifted), float(np.linalg.norm(speed))
