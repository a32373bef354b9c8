"""What `check` says of a recording while it grows, on /diagnostics and on the terminal."""

from __future__ import annotations

import sys
import time
from concurrent.futures import Future
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_dynamics_ros.core.errors import TactileDynamicsError

if TYPE_CHECKING:
    from tactile_dynamics_ros.api.readiness import Readiness
    from tactile_dynamics_ros.ros.recorder import Recorder

_SENTENCES = 3
"""Sentences that are reported at a time; more are not read while a hand moves."""


@dataclass(frozen=True)
class Said:
    """What is said of a recording so far.

    Attributes:
        ready: whether it is fit for an estimate. text: why not, and what to record as well.
        relative: standard deviation over size by parameter.
    """

    ready: bool
    text: str
    relative: dict[str, float]


def check_so_far(path: str, namespace: str | None) -> Said:
    """Check what is in the file of a recording by now."""
    try:
        found = _checked(path, namespace)
    except TactileDynamicsError as error:
        return Said(False, f"nothing to say yet: {' '.join(str(error).split())}", {})
    if found.ready:
        return Said(True, f"ready: every parameter is known to {found.goal:.0%}", found.relative)
    said = [*found.faults, *found.advice()]
    return Said(False, "; ".join(said[:_SENTENCES]), found.relative)


def _checked(path: str, namespace: str | None) -> Readiness:
    from tactile_dynamics_ros.api.reading import read_recording
    from tactile_dynamics_ros.api.verbs import check
    from tactile_dynamics_ros.recording.joints import JointRecording
    from tactile_dynamics_ros.recording.kinds import recorded_kind
    from tactile_dynamics_ros.recording.pushed import PushedRecording

    kind = recorded_kind(path)
    if kind == "joints":
        return check(JointRecording.read(path))
    if kind == "pushed":
        return check(PushedRecording.from_bag(path, namespace=namespace))
    return check(read_recording(path, namespace=namespace))


class RecordCheck:
    """Checks a recording again and again, in a process of low priority.

    Args:
        recorder: that writes it, and under whose name it is reported.
        path: of the recording.
        namespace: of the hand, or None.
        period: s between the end of a check and the next.
        quiet: whether nothing is printed.
    """

    def __init__(
        self, recorder: Recorder, path: str, namespace: str | None, period: float, quiet: bool
    ) -> None:
        from tactile_dynamics_ros.ros.background import Background

        self._recorder, self._path, self._namespace = recorder, path, namespace
        self._period, self._quiet = period, quiet
        self._background = Background()
        self._running: Future[Said] | None = None
        self._next = time.monotonic() + period
        self._last = ""

    def advance(self) -> None:
        """Begin a check that is due, report one that is done."""
        if self._running is None:
            if time.monotonic() >= self._next:
                self._running = self._background.submit(check_so_far, self._path, self._namespace)
            return
        if not self._running.done():
            return
        running, self._running = self._running, None
        self._next = time.monotonic() + self._period
        try:
            self._tell(running.result())
        except TactileDynamicsError as error:
            self._tell(Said(False, str(error), {}))

    def close(self) -> None:
        """End the process."""
        self._background.close()

    def _tell(self, said: Said) -> None:
        from diagnostic_msgs.msg import DiagnosticStatus

        level = DiagnosticStatus.OK if said.ready else DiagnosticStatus.WARN
        values = {f"{name}_relative_std": share for name, share in said.relative.items()}
        self._recorder.faults.tell("check", said.text, {"ready": said.ready, **values}, level)
        if said.text != self._last and not self._quiet:
            print(f"check: {said.text}", file=sys.stderr, flush=True)
        self._last = said.text
