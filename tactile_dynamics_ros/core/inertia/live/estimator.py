"""The live estimator: streams in, a feasible inertia with honest uncertainty out."""

from __future__ import annotations

import math
import time as clock
from collections import Counter

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.live.accumulation import Accumulation
from tactile_dynamics_ros.core.inertia.live.config import IncrementalConfig
from tactile_dynamics_ros.core.inertia.live.contact_queue import ContactReading
from tactile_dynamics_ros.core.inertia.live.live_estimate import LiveEstimate
from tactile_dynamics_ros.core.inertia.live.sample_stream import PoseNoise, SampleStream
from tactile_dynamics_ros.core.inertia.live.shape_watch import ShapeWatch
from tactile_dynamics_ros.core.inertia.live.summary import Summariser
from tactile_dynamics_ros.core.inertia.shape_prior import ShapePrior
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    affine_invariant_distance,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.shape.solid import CentreHull
from tactile_dynamics_ros.core.streams.pose_noise import read_covariances
from tactile_dynamics_ros.core.streams.streams import ContactSample

_REVISE_DISTANCE = 0.3
"""Affine-invariant distance between the body that whitened the samples and the present estimate
from which kept samples are processed again: 0.3 is a body of the same shape that is 16 % heavier. A
smaller value processes samples again for a whitening that hardly differs, a larger one keeps
weights that belong to another body."""
_REVISE_SAMPLES = 6
"""Samples before the first look at that distance, 60 ms at 100 Hz; each later look comes after
twice as many, so that all revisions together cost no more than the samples themselves. The first
samples are whitened and linearised at the prior; at 50 that was in all estimates of the first 0.8
s, which were up to 18 standard deviations off. Fewer revise by what the prior says."""


class IncrementalInertialEstimator:
    """Estimate mass, centre of mass and inertia of the held rigid body at every update.

    All data so far are summarised exactly by the square-root information [R | d] of the whitened
    Newton-Euler residuals, which are linear in the parameters; iSAM2 solves for log-Cholesky
    coordinates, so that every estimate is a body that can exist. Memory and time per update do not
    grow. A sample is processed once its windows are complete, 0.12 s after its stamp.

    The whitening depends a little on the parameters. While the first samples are still kept, they
    are processed again, a few per update, whenever the estimate has moved away from that used.
    """

    def __init__(self, config: IncrementalConfig | None = None) -> None:
        """Start without data."""
        self._config = config or IncrementalConfig()
        self._hull: CentreHull | None = None
        self._shape: ShapeWatch | None = None
        self._problems: Counter[str] = Counter()
        self.reset()

    @property
    def problems(self) -> dict[str, int]:
        """Counts of readings that could not be used as they came, by kind, since the beginning."""
        return dict(self._problems)

    @property
    def obstacles(self) -> tuple[str, ...]:
        """What is wrong with the newest readings, so that nothing should be concluded now."""
        obstacles = self._stream.obstacles
        if self._model.solver is None or self._model.phi[0] <= self._config.maximum_mass:
            return obstacles
        return (
            *obstacles,
            f"the model does not fit: a mass of {self._model.phi[0]:.4g} kg is more than "
            f"maximum_mass = {self._config.maximum_mass:g} kg; are the forces in N?",
        )

    def reset(self) -> None:
        """Forget all measurements; hull and shape stay, and what was counted."""
        self._stream = SampleStream(self._config, self._problems)
        self._newest = -np.inf
        self._seen = 0
        self._renew_summary()
        self._model = Accumulation(self._config, self._stream)
        self._successor: Accumulation | None = None
        self._next_revision = _REVISE_SAMPLES

    def begin_stretch(self) -> None:
        """Join no later sample with those before, whose clock was another; what is known stays."""
        self._stream.begin_again()
        self._newest, self._successor = -np.inf, None

    def set_hull(self, vertices: Array | None) -> None:
        """Keep the centre of mass inside the convex hull of mesh vertices (N, 3), body frame, m.

        Raises:
            BadInputError: the vertices do not span a volume.
        """
        self._hull = None if vertices is None else CentreHull.of_points(vertices)
        self._renew_summary()

    def set_shape(self, prior: ShapePrior | None) -> None:
        """Hold the estimate against the shape that the body fills; None for no shape.

        Args:
            prior: of the shape, whose axes are those of the object's pose.
        """
        self._shape = None if prior is None else ShapeWatch(prior)
        self._renew_summary()

    def _renew_summary(self) -> None:
        if self._shape is not None:
            self._shape.reset()
        self._summariser = Summariser(self._hull, self._shape)

    def add_pose(self, t: float, X_WO: Array, covariance: Array | None) -> None:
        """Add a pose of the object.

        Args:
            t: s.
            X_WO: (4, 4).
            covariance: (6, 6) [rotation about world axes, position]; None or zero if not stated.
                What it says that cannot be meant is counted; a lost pose leaves a gap.
        """
        X_WO = np.asarray(X_WO, dtype=float)
        if not (np.isfinite(t) and np.all(np.isfinite(X_WO))):
            self._problems["pose not finite"] += 1
            return
        given = np.zeros((6, 6)) if covariance is None else np.asarray(covariance, dtype=float)
        said = read_covariances(given[None])
        for mistake in said.mistakes:
            self._problems[f"pose {mistake}"] += 1
        if said.lost[0]:
            self._problems["pose lost by its tracker"] += 1
            return
        noise = self._pose_noise(said.covariance[0], bool(said.stated[0]))
        before = self._stream.newest
        self._stream.add_pose(t, X_WO[:3, 3], X_WO[:3, :3], noise)
        if self._stream.newest < before:
            self._newest, self._successor = -np.inf, None
        self._newest = max(self._newest, t)

    def add_contact(self, contact: ContactSample) -> None:
        """Add what one contact applies on the object; the scatter stands for an unstated std."""
        given = (contact.point, contact.rotation, contact.force, contact.torque)
        point, rotation, force, torque = (np.asarray(values, dtype=float) for values in given)
        flat = np.concatenate([point, rotation.ravel(), force, torque])
        if not math.isfinite(contact.time + sum(flat.tolist())):
            self._problems[f"contact '{contact.name}' not finite"] += 1
            return
        std = np.full(3, np.nan) if contact.std is None else np.asarray(contact.std, dtype=float)
        if not all(0.0 < value < math.inf for value in std.tolist()):
            std = np.full(3, np.nan)
        reading = ContactReading(point, rotation, force, torque, std)
        self._stream.add_contact(contact.name, contact.time, reading)
        self._newest = max(self._newest, contact.time)

    def update(self, now: float | None = None) -> LiveEstimate | None:
        """Process all complete samples and return the present estimate.

        Args:
            now: s, time up to which all readings have arrived; the newest stamp by default.

        Returns:
            None until the object has been held for one complete sample.
        """
        started = clock.perf_counter()
        self._stream.align(self._newest if now is None else max(now, self._newest))
        arrived, self._seen = self._stream.end - self._seen, self._stream.end
        self._model.advance(self._config.replay_batch + arrived)
        self._revise(arrived)
        if self._model.solver is None:
            return None
        return self._summariser.summarise(self._model, clock.perf_counter() - started)

    def _revise(self, arrived: int) -> None:
        """Process the kept samples again if their whitening assumed quite another body."""
        if self._successor is not None:
            # Twice what arrived: it catches up however rarely updates come.
            self._successor.advance(self._config.replay_batch + 2 * arrived)
            if self._successor.is_current:
                self._successor.resume()
                self._model, self._successor = self._successor, None
            return
        model = self._model
        if model.samples < self._next_revision or model.start < self._stream.first:
            return
        self._next_revision *= 2
        assert model.assumed is not None
        present = pseudo_inertia(model.phi)
        if affine_invariant_distance(pseudo_inertia(model.assumed), present) > _REVISE_DISTANCE:
            self._successor = Accumulation(self._config, self._stream)
            self._successor.assume(model)

    def _pose_noise(self, covariance: Array, stated: bool) -> PoseNoise:
        if stated:
            blocks = np.stack([covariance[:3, :3], covariance[3:, 3:]])
            return PoseNoise(np.asarray(np.linalg.cholesky(blocks)), True)
        std = np.array([self._config.rotation_std, self._config.position_std])
        return PoseNoise(std[:, None, None] * np.eye(3), False)
