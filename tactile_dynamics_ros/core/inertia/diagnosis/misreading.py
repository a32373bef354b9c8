"""A recording as a model that can be asked whether it uses another convention."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from tactile_dynamics_ros.core.discrepancy.model.residual_model import Convention
from tactile_dynamics_ros.core.inertia.batch.averaging import averaged
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.conventions.finder import assumed, find_convention
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.core.streams.streams import Streams

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


def question(
    streams: Streams, effects: Sequence[Effect] = (), fitted: FittedModel | None = None
) -> HeldObjectModel:
    """The model of a recording, with other readings of the recording to be tried.

    Args:
        streams: measurements.
        effects: effects of the model.
        fitted: fit of the model, if there is one already.

    Raises:
        BadInputError: contacts and motion are missing, or the contacts cannot show an effect.
    """
    streams = averaged(streams)

    def misread(recorded: float) -> Convention | None:
        return find_convention(streams, recorded, lambda other: question(other, effects))

    model = HeldObjectModel.from_fit(fitted or fit_with_readings(streams, effects))
    return replace(model, misread=misread)


def read_as(streams: Streams, names: Sequence[str]) -> Streams:
    """Read a recording as conventions say, one after the other, each in the form that fits best.

    Args:
        streams: as recorded.
        names: of the conventions, in the order in which they were found.

    Raises:
        BadInputError: the recording cannot be read so.
    """
    for name in names:
        streams, _ = assumed(streams, name)
    return streams
