"""The model that model_check holds against measurements: a held object, or a pushed one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from tactile_dynamics_ros.core.discrepancy.documents import Document
from tactile_dynamics_ros.core.discrepancy.live_check import (
    LiveCheckConfig,
    LiveComparison,
    LiveModelCheck,
)
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.diagnosis.live_check import (
    compare_streams,
    diagnose_streams,
    learn_from_streams,
)
from tactile_dynamics_ros.core.planar.diagnosis.changed import ChangeCheck
from tactile_dynamics_ros.core.planar.filter.record import PushWindow
from tactile_dynamics_ros.core.streams.measurement_window import MeasurementWindow
from tactile_dynamics_ros.recording.bag_writer import write_bag
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.ros.held_streams import HeldStreams
from tactile_dynamics_ros.ros.names import CONTACTS, ESTIMATOR_STATUS, PROPERTY_STATUS
from tactile_dynamics_ros.ros.object_state import ObjectState
from tactile_dynamics_ros.ros.pusher_streams import PADS, PUSHER
from tactile_dynamics_ros.ros.pushing_streams import PushingStreams
from tactile_dynamics_ros.ros.shell import Shell

MODELS = ("held", "pushed")


@dataclass(frozen=True)
class CheckedModel:
    """What is measured of an object, and what is asked about it.

    Attributes:
        window: of measurements.
        check: what is to be computed on it.
        streams: subscriptions that fill the window; `release` hands on what need not wait, `state`
            says what is heard of the object.
        status: topic that tells the effects of the model.
        diagnose: of streams with effects.
        write: streams to a recording.
        change: knows since when pushes count; None of a held object.
    """

    window: Any
    check: LiveModelCheck[Any]
    streams: Any
    status: str
    diagnose: Callable[..., dict[str, Any]]
    write: Callable[..., Any]
    change: ChangeCheck | None = None


def checked_model(
    node: Shell, model: str, contacts: Sequence[str], iterations: int, span: LiveCheckConfig,
    kept: float,
) -> CheckedModel:  # fmt: skip
    """Subscribe to what a model needs.

    Args:
        node: that subscribes.
        model: held or pushed.
        contacts: their names; those of the hand, or of the pusher, if empty.
        iterations: of the fit of a comparison of a held object.
        span: of comparison and diagnosis.
        kept: s that are kept.

    Raises:
        BadInputError: there is no such model.
    """
    if model == "held":
        held = MeasurementWindow(kept)
        compare = partial(compare_streams, iterations=iterations)
        return CheckedModel(
            held,
            LiveModelCheck(held, compare, diagnose_streams, span, learn_from_streams),
            HeldStreams(
                node,
                contacts or CONTACTS,
                held.add_pose,
                held.add_contact,
                held.clear,
                held.step_back,
            ),
            ESTIMATOR_STATUS,
            diagnose_streams,
            write_bag,
        )
    if model != "pushed":
        raise BadInputError(f"model '{model}': expected {' or '.join(MODELS)}")
    pushed = PushWindow(kept)
    change = ChangeCheck()
    pushes: Callable[[Any, tuple[str, ...]], LiveComparison] = change.compare
    return CheckedModel(
        pushed,
        LiveModelCheck(pushed, pushes, change.diagnose, span),
        PushingStreams(node, contacts or (PUSHER, *PADS), pushed, pushed.clear, pushed.second),
        PROPERTY_STATUS,
        change.diagnose,
        write_pushes,
        change,
    )


def diagnose_measured(work: Callable[[], Document], state: ObjectState) -> Document:
    """Diagnose, and say in the sentence where the measurements are not of now.

    Args:
        work: diagnoses the last measurements.
        state: of the object when the diagnosis was asked for.
    """
    document = work()
    if state.current:
        return document
    said = f"Diagnosed from the last measurements that were kept; now: {state.text}."
    return document | {"sentence": f"{document['sentence']} {said}"}


def write_pushes(streams: Any, path: Any) -> None:
    """Write streams of pushes to a recording."""
    PushedRecording(streams, str(path)).to_bag(path)
