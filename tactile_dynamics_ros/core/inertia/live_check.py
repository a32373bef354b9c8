"""The model held against the last seconds of live measurements."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.discrepancy.asking import ask_twice
from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis, diagnose
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch import BatchConfig, fit_recording
from tactile_dynamics_ros.core.inertia.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.readings import fit_with_readings, model_with_seen_noise
from tactile_dynamics_ros.core.streams import ContactStream, PoseStream, Streams

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LiveCheckConfig:
    """Spans of the live comparison."""

    error_window: float = parameter(10.0, "span over which the error is taken", "s", 2.0, 60.0)
    diagnosis_window: float = parameter(40.0, "span that is diagnosed", "s", 5.0, 300.0)
    iterations: int = parameter(2, "iterations of the fit of a comparison", "", 1, 10)

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)


@dataclass(frozen=True)
class LiveComparison:
    """Model against measurements over the last seconds.

    Attributes:
        time: (N,) s.
        residual: (N, 6) measured minus predicted wrench [torque, force], body frame.
        whitened_rms: 1 where only the stated noise remains.
    """

    time: Array
    residual: Array
    whitened_rms: float


@dataclass
class _ContactBuffer:
    wrenches: deque[tuple[float, Array, Array, Array | None]] = field(default_factory=deque)
    poses: deque[tuple[float, Array, Array]] = field(default_factory=deque)


class LiveModelCheck:
    """Keeps the last seconds of measurements; compares and diagnoses the model on them."""

    def __init__(self, config: LiveCheckConfig | None = None) -> None:
        """Start without measurements and with the rigid body alone."""
        self._config = config or LiveCheckConfig()
        self._effects: tuple[Effect, ...] = ()
        self.reset()

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects of the model."""
        return self._effects

    def reset(self) -> None:
        """Forget all measurements."""
        self._poses: deque[tuple[float, Array, Array | None]] = deque()
        self._contacts: dict[str, _ContactBuffer] = {}

    def set_effects(self, effects: Sequence[Effect]) -> None:
        """Change the model that is checked."""
        self._effects = tuple(effects)

    def add_pose(self, t: float, X_WO: Array, covariance: Array | None) -> None:
        """Add a pose (4, 4) with covariance (6, 6) [rotation, position]; old ones are dropped."""
        if self._poses and t <= self._poses[-1][0]:
            return
        self._poses.append((t, X_WO, covariance))
        _drop_before(self._poses, t - self._config.diagnosis_window)

    def add_contact(
        self,
        t: float,
        name: str,
        point_W: Array,
        R_W: Array,
        force_W: Array,
        std_W: Array | None = None,
        torque_W: Array | None = None,
    ) -> None:
        """Add what one contact applies on the object, world axes; old readings are dropped."""
        buffer = self._contacts.setdefault(name, _ContactBuffer())
        if buffer.wrenches and t <= buffer.wrenches[-1][0]:
            return
        torque = np.zeros(3) if torque_W is None else torque_W
        buffer.wrenches.append((t, force_W, torque, std_W))
        buffer.poses.append((t, point_W, R_W))
        for entries in (buffer.wrenches, buffer.poses):
            _drop_before(entries, t - self._config.diagnosis_window)

    def snapshot(self) -> LiveModelCheck:
        """Return a copy to compute on while measurements go on coming in here."""
        copy = LiveModelCheck(self._config)
        copy._effects = self._effects
        copy._poses = self._poses.copy()
        copy._contacts = {
            name: _ContactBuffer(buffer.wrenches.copy(), buffer.poses.copy())
            for name, buffer in self._contacts.items()
        }
        return copy

    def compare(self) -> LiveComparison:
        """Fit the model to the last `error_window` seconds.

        Raises:
            BadInputError: too little has been measured yet.
        """
        config = BatchConfig(iterations=self._config.iterations)
        model = fit_recording(self.streams(self._config.error_window), self._effects, config)
        samples = model.samples[0]
        start = model.blocks[0].problem.start
        return LiveComparison(samples.time + start, -model.smooth_residual(), model.whitened_rms)

    def diagnose(self) -> Diagnosis:
        """Diagnose the model on all kept measurements, as `tactile-dynamics diagnose` does.

        Raises:
            BadInputError: too little has been measured yet.
        """
        streams = self.streams(self._config.diagnosis_window)
        model = HeldObjectModel.from_fit(fit_with_readings(streams, self._effects))
        return ask_twice(
            diagnose, model, lambda: model_with_seen_noise(model, streams, self._effects)
        )[0]

    def streams(self, window: float) -> Streams:
        """The last `window` seconds of measurements.

        Raises:
            BadInputError: there are none.
        """
        if len(self._poses) < 2 or not self._contacts:
            raise BadInputError("nothing held yet: no object pose or no contact has arrived")
        first = self._poses[-1][0] - window
        contacts = {
            name: stream
            for name, buffer in self._contacts.items()
            if (stream := _contact_stream(name, buffer, first)) is not None
        }
        return Streams(_pose_stream(self._poses, first), contacts)


def _drop_before(entries: deque[Any], first: float) -> None:
    while entries and entries[0][0] < first:
        entries.popleft()


def _pose_stream(entries: deque[tuple[float, Array, Array | None]], first: float) -> PoseStream:
    kept = [entry for entry in entries if entry[0] >= first]
    matrices = np.array([entry[1] for entry in kept])
    covariances = [entry[2] for entry in kept if entry[2] is not None]
    return PoseStream(
        time=np.array([entry[0] for entry in kept]),
        position=matrices[:, :3, 3],
        rotation=matrices[:, :3, :3],
        covariance=np.array(covariances) if len(covariances) == len(kept) else None,
    )


def _contact_stream(name: str, buffer: _ContactBuffer, first: float) -> ContactStream | None:
    wrenches = [entry for entry in buffer.wrenches if entry[0] >= first]
    poses = [entry for entry in buffer.poses if entry[0] >= first]
    if len(wrenches) < 2 or len(poses) < 2:
        return None
    torque = np.array([entry[2] for entry in wrenches])
    stds = [entry[3] for entry in wrenches if entry[3] is not None]
    return ContactStream(
        name=name,
        time=np.array([entry[0] for entry in wrenches]),
        force=np.array([entry[1] for entry in wrenches]),
        torque=torque,
        force_std=np.array(stds) if len(stds) == len(wrenches) else None,
        pose_time=np.array([entry[0] for entry in poses]),
        position=np.array([entry[1] for entry in poses]),
        rotation=np.array([entry[2] for entry in poses]),
        carries_torque=bool(np.any(torque != 0.0)),
    )
