"""The one door to an estimate of a held object from what was recorded of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.registry import create_effects
from tactile_dynamics_ros.core.effects.sensor_zero import with_zero
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.batch.averaging import averaged
from tactile_dynamics_ros.core.inertia.batch.batch import fit_body
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.fitting import fit_from
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.inertia.batch.pose_noise_bias import widen_by_pose_noise
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.core.inertia.shape_prior import ShapePrior
from tactile_dynamics_ros.core.shape.solid import CentreHull, keep_in_hull
from tactile_dynamics_ros.core.streams.streams import Streams

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


FROM_SHAPE = 2
"""Rounds of the alternation that follow when a fit begins anew from a shape: the noise is known
from the fit before, so that fewer than its four do. One leaves the noise of the old start."""


class Recorded(Protocol):
    """Anything with the streams of a held object, such as a `Recording`."""

    @property
    def streams(self) -> Streams:
        """What was measured."""


def estimate(
    recording: Streams | Recorded,
    effects: Sequence[Effect] = (),
    hull: Array | None = None,
    fitted: FittedModel | None = None,
    shape: ShapePrior | None = None,
) -> FittedModel:
    """Estimate mass, centre of mass and inertia of a held object, and the parameters of effects.

    A body alone is corrected by lasting errors of its sensors; beside effects, which may be those,
    it is not. Effects that are named without a reading get the one with the best evidence. The zero
    of a single sensor (`force_bias`) is always estimated too.

    Args:
        recording: streams, or what has them.
        effects: effects of the model, in the order of the result.
        hull: (N, 3) mesh vertices, body frame, m; the centre of mass is kept in their convex hull.
        fitted: `fit_with_readings` of the recording and the effects, if there is one already.
        shape: about which the fit begins, so that `with_shape` can follow.

    Returns:
        The fitted model; `to_estimate()` gives values with their uncertainty.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap, the contacts cannot show
            an effect, or the vertices span no volume.
        NotIdentifiableError: the iteration diverged.
    """
    streams = averaged(recording if isinstance(recording, Streams) else recording.streams)
    effects = with_zero(streams.contacts, effects)
    if effects:
        model = widen_by_pose_noise(fitted or fit_with_readings(streams, effects), streams)
    else:
        model = fit_body(streams)
    if shape is not None:
        model = fit_from(model, shape.start, FROM_SHAPE)
    if hull is None:
        return model
    data, prior = (part[:10, :10] for part in model.coordinate_information)
    return replace(model, xi=keep_in_hull(model.xi, data + prior, CentreHull.of_points(hull)))


def estimate_rivals(
    recording: Streams | Recorded,
    effects: Sequence[str],
    groups: Mapping[str, Sequence[str]],
) -> dict[str, InertialEstimate]:
    """Estimate with each effect that the data cannot tell from one of the model, in its place.

    Args:
        recording: streams, or what has them.
        effects: names of the effects of the model.
        groups: by effect of the model, those that cannot be told from it; itself may be among them.

    Returns:
        The estimate with each that can be fitted, by its name.
    """
    found = {}
    for name, other in ((name, other) for name, group in groups.items() for other in group):
        if other != name and name in effects:
            names = [other if one == name else one for one in effects]
            with suppress(TactileDynamicsError):
                found[other] = estimate(recording, create_effects(names)).to_estimate()
    return found
