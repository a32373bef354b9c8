"""What has changed while an object was pushed: the pushes since then, then all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.discrepancy.documents import Document
from tactile_dynamics_ros.core.discrepancy.live_check import LiveComparison
from tactile_dynamics_ros.core.planar.diagnosis.live_check import compare_pushes, diagnose_pushes
from tactile_dynamics_ros.core.planar.streams import PushedStreams

SUDDEN = ("friction_change", "load_change")
"""Effects that begin at one time: pushes before and after them tell them, those after alone do not,
because an object that has become heavier is like one that always was."""

_REMAINS = 1.1
"""Error over the noise floor up to which the pushes since a change fit: a tenth is what other
pushes of one clean table differ by. Lower, sudden changes are called unexplained; higher, small
leans are taken for other numbers."""


def diagnose_change(
    streams: PushedStreams, effects: Sequence[str] = (), since: float = -np.inf
) -> Document:
    """Diagnose what came with a change.

    The pushes since the change show what acts now and did not before, such as a table that leans.
    Where the model fits them, only its numbers have changed: then all pushes are diagnosed, for an
    effect that began at one time.

    Args:
        streams: pushes before and after.
        effects: names of the effects in the model.
        since: s, of the change; by default all pushes are diagnosed once.

    Raises:
        BadInputError: nothing is touched since then.
        NotIdentifiableError: nothing slides long enough.
    """
    document = diagnose_pushes(streams_since(streams, since), effects)
    if not np.isfinite(since) or not _fits(document):
        return document
    whole = diagnose_pushes(streams, effects)
    if whole["effect"] in SUDDEN:
        return whole
    said = "Since the change the model fits, with other numbers than before; nothing is missing."
    return document | {"sentence": said}


def _fits(document: Document) -> bool:
    """Whether nothing worth naming is missing."""
    error = document["error"]
    little = document["effect"] is None and error["before"] < _REMAINS * error["noise_floor"]
    return bool(document["verdict"] == "adequate" or little)


@dataclass
class ChangeCheck:
    """A model of pushes, held against those since the latest change.

    Attributes:
        since: s, of the change; minus infinity where there was none.
    """

    since: float = -np.inf

    def compare(self, streams: PushedStreams, effects: Sequence[str]) -> LiveComparison:
        """What a fitted model leaves of the pushes since the change."""
        return compare_pushes(streams_since(streams, self.since), effects)

    def diagnose(self, streams: PushedStreams, effects: Sequence[str]) -> Document:
        """Diagnose what came with the change, or the model itself."""
        return diagnose_change(streams, effects, self.since)


def streams_since(streams: PushedStreams, time: float) -> PushedStreams:
    """What was measured from a time, s, on."""
    if not np.isfinite(time):
        return streams
    after = streams.between(time, np.inf)
    kept = {name: contact for name, contact in after.contacts.items() if len(contact.time)}
    return replace(after, contacts=kept)
