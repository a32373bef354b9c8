"""A fitted arm as a document, and the torques of the world on it while it moves."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.effects import (
    JOINTS,
    GatedJointEffect,
    JointEffect,
    gate_effect,
)
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.joints.situation import Situation
from tactile_dynamics_ros.core.numerics.regime import split_label
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams

_KIND = "joints"
"""What the document says that it is; fixed, so that other files of estimates are refused."""
WITH_HISTORY = ("backlash", "friction_warming", "torque_delay", "torque_drift")
"""Effects that depend on what happened before the last tenth of a second: a live model leaves them
out and says so."""
_WEAK = 0.003
"""Smallest singular value of the flange's Jacobian, m (or without a unit for turns), from which a
wrench is told: below, the arm is next to a singular pose, where a newton changes no torque by more
than 3 mN m. Above, the standard deviations of the wrench say which directions are weak."""
_STUCK = 0.5
"""Share of a block without motion from which a joint stands: friction may then be anything up to
its Coulomb friction, in either direction."""


_Measured = tuple[float, Array, Array]
"""Time, s, positions (n,) and efforts (n,)."""


@dataclass(frozen=True, eq=False)
class KnownArm:
    """What is known of an arm.

    Attributes:
        joints: names.
        bodies: (n, 10) dynamic parameters of each link in its own frame, without the payload.
        payload: (10,) in the last link's frame.
        friction: (3, n) Coulomb friction, viscous friction, offset.
        noise: (n,) noise of a block's mean torque, N m.
        std: (n,) RMS error of the model's torques, N m, with their noise.
        effects: with their parameters.
    """

    joints: tuple[str, ...]
    bodies: Array
    payload: Array
    friction: Array
    noise: Array
    std: Array
    effects: tuple[tuple[JointEffect, Array], ...] = ()

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the effects, with readings."""
        return tuple(effect.label for effect, _ in self.effects)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the effects that are not predicted live."""
        return tuple(effect.name for effect, _ in self.effects if _needs_past(effect))

    def situation(self, samples: JointSamples) -> Situation:
        """What the effects act on in other samples."""
        return Situation(samples, self.bodies, self.payload, self.friction)

    def predict(self, samples: JointSamples, past: bool = False) -> Array:
        """(K, n) mean torque of each block, N m.

        Args:
            samples: blocks.
            past: whether effects that depend on the past are predicted too.
        """
        situation = self.situation(samples)
        found = situation.total
        for effect, theta in self.effects:
            if past or not _needs_past(effect):
                found = found + effect.torque(situation, theta)
        return found

    def error(self, samples: JointSamples, std: Array) -> float:
        """RMS of the error of the predicted torques, in units of a std (n,) of a block's mean."""
        return float(np.sqrt(np.mean(((self.predict(samples) - samples.effort) / std) ** 2)))

    def to_document(self) -> dict[str, Any]:
        """Plain numbers."""
        arrays = ("bodies", "payload", "friction", "noise", "std")
        return {
            "model": _KIND,
            "joints": list(self.joints),
            **{name: getattr(self, name).tolist() for name in arrays},
            "effects": [
                {"name": effect.name, "reading": _reading(effect), "parameters": theta.tolist()}
                for effect, theta in self.effects
            ],
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any], source: str) -> KnownArm:
        """Read what `to_document` gives.

        Args:
            document: parsed.
            source: named in errors.

        Raises:
            BadInputError: it is something else.
        """
        if document.get("model") != _KIND:
            raise BadInputError(
                f"{source}: no model of an arm's joints; expected a file of `estimate --save`"
            )
        try:
            effects = tuple(_effect(entry) for entry in document["effects"])
            bodies, payload, friction, noise, std = (
                np.array(document[name], dtype=float)
                for name in ("bodies", "payload", "friction", "noise", "std")
            )
            names = tuple(str(name) for name in document["joints"])
            return cls(names, bodies, payload, friction, noise, std, effects)
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(
                f"{source}: the model of the arm cannot be read ({error})"
            ) from error


@dataclass(frozen=True)
class MonitorConfig:
    """How torques are averaged, and what counts as touched."""

    block: float = parameter(
        0.04, "time over which torques are averaged; answers are one and a half of it late", "s",
        0.004, 0.5,
    )  # fmt: skip
    significance: float = parameter(
        4.0, "standard deviations of a joint's torque from which something touches the arm", "",
        2.0, 20.0,
    )  # fmt: skip
    window: float = parameter(
        30.0, "newest measurements that effects are fitted to", "s", 10.0, 120.0
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class ExternalTorque:
    """What the world applies on an arm at one time.

    Attributes:
        time: s, middle of the block.
        predicted: (n,) torques of the drives by the model, N m.
        external: (n,) torques of the world on the joints, N m: predicted minus measured.
        std: (n,) their standard deviations.
        wrench: (6,) [torque, force] on the flange in its axes that explains them best.
        wrench_std: (6,).
        doubt: why wrench and torques are not to be believed; empty if they are.
    """

    time: float
    predicted: Array
    external: Array
    std: Array
    wrench: Array
    wrench_std: Array
    doubt: str

    def touched(self, significance: float) -> tuple[int, ...]:
        """Joints whose torque is beyond what noise and friction make."""
        return tuple(np.flatnonzero(np.abs(self.external) > significance * self.std).tolist())


class JointMonitor:
    """Compares measured joint torques with a fitted model, block by block.

    Attributes:
        arm: whose torques come.
        known: its model.
    """

    def __init__(self, arm: Arm, known: KnownArm, config: MonitorConfig | None = None) -> None:
        """Begin without measurements.

        Args:
            arm: by its URDF.
            known: fitted, of `estimate --save`.
            config: of averaging.

        Raises:
            BadInputError: the model is of other joints.
        """
        if arm.names != known.joints:
            raise BadInputError(
                f"model of joints {', '.join(known.joints)}; the URDF has {', '.join(arm.names)}"
            )
        self.arm, self.known, self.config = arm, known, config or MonitorConfig()
        self._window: deque[_Measured] = deque(maxlen=4000)
        self._kept: deque[_Measured] = deque()

    @property
    def span(self) -> float:
        """Seconds of measurements that are kept for a fit."""
        return self._kept[-1][0] - self._kept[0][0] if self._kept else 0.0

    def recent(self, urdf: str) -> JointStreams:
        """What was measured in the newest `window`, from time zero on.

        Args:
            urdf: text of the arm's URDF.
        """
        time, position, effort = (np.array(part) for part in zip(*self._kept, strict=True))
        return JointStreams(self.arm.names, time - time[0], position, effort, urdf)

    def add(self, time: float, position: Array, effort: Array) -> None:
        """Take one measurement; what is older than needed is forgotten, as is all before a gap."""
        if self._window and not 0.0 < time - self._window[-1][0] < self.config.block:
            self._window.clear()
        self._keep(self._window, (time, position, effort), 3.5 * self.config.block)
        if self._kept and time <= self._kept[-1][0]:
            self._kept.clear()
        self._keep(self._kept, (time, position, effort), self.config.window)

    @staticmethod
    def _keep(kept: deque[_Measured], measured: _Measured, span: float) -> None:
        kept.append(measured)
        while kept[-1][0] - kept[0][0] > span:
            kept.popleft()

    def flange_poses(self, since: float, until: float) -> tuple[Array, Array]:
        """Stamps (M,), s, and poses (M, 4, 4) of the flange in the base, of measurements kept.

        Args:
            since: s, before the first.
            until: s, at the last.
        """
        kept = [(t, q) for t, q, _ in self._window if since < t <= until]
        time, q = np.array([t for t, _ in kept]), np.array([q for _, q in kept])
        found = np.tile(np.eye(4), (len(kept), 1, 1))
        if kept:
            moved = self.arm.motion(q, np.zeros_like(q), np.zeros_like(q))
            found[:, :3, :3], found[:, :3, 3] = moved.turns[-1], moved.places[-1]
        return time, found @ self.arm.flange_pose

    def latest(self) -> ExternalTorque | None:
        """What the world applied in the newest block with neighbours; None without enough yet."""
        if len(self._window) < 12:
            return None
        time, position, effort = (np.array(part) for part in zip(*self._window, strict=True))
        period = float(np.median(np.diff(time)))
        count = max(4, round(self.config.block / period))
        if len(time) < 3 * count:
            return None
        start = np.array([len(time) - 2 * count])
        signals = (time, position, effort)
        samples = JointSamples.of_blocks(self.arm, signals, start, count, period)
        return self._told(samples, float(time[0] + samples.time[0]))

    def _told(self, samples: JointSamples, time: float) -> ExternalTorque:
        known = self.known
        predicted = known.predict(samples)
        external = (predicted - samples.effort)[0]
        standing = samples.turning[0] > _STUCK
        std = np.hypot(known.std, standing * known.friction[0])
        wrench, wrench_std, weakest = _at_flange(samples, external, std)
        doubts = []
        if weakest < _WEAK:
            doubts.append("the arm is next to a singular pose: no wrench is told")
        if standing.any():
            names = [n for n, s in zip(self.arm.names, standing, strict=True) if s]
            doubts.append(f"{', '.join(names)} stand still, held by friction")
        return ExternalTorque(
            time, predicted[0], external, std, wrench, wrench_std, "; ".join(doubts)
        )


def _at_flange(samples: JointSamples, external: Array, std: Array) -> tuple[Array, Array, float]:
    """Wrench on the flange with J^T w = tau in the sense of least squares, its std, and how well.

    Returns:
        (6,), (6,) and the smallest singular value of the flange's Jacobian.
    """
    jacobian = samples.arm.flange_jacobian(samples.motions[1])[0]
    weighed = (jacobian / std).T
    covariance = np.linalg.pinv(weighed.T @ weighed)
    wrench = covariance @ weighed.T @ (external / std)
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    values = np.linalg.svd(jacobian, compute_uv=False)
    return wrench, spread, float(values[-1]) if len(values) == 6 else 0.0


def _needs_past(effect: JointEffect) -> bool:
    """Whether an effect depends on what happened before, or on the time of a recording."""
    if isinstance(effect, GatedJointEffect):
        timed = any(gate.symbol == "t" for gate in effect.regime.gates)
        return timed or _needs_past(effect.inner)
    return effect.name in WITH_HISTORY


def _reading(effect: JointEffect) -> dict[str, Any]:
    return asdict(effect.inner if isinstance(effect, GatedJointEffect) else effect)


def _effect(entry: Mapping[str, Any]) -> tuple[JointEffect, Array]:
    fields = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in entry["reading"].items()
    }
    plain, regime = split_label(entry["name"])
    found = type(JOINTS.create(plain))(**fields)
    gated = found if regime is None else gate_effect(found, regime)
    return gated, np.array(entry["parameters"], dtype=float)
