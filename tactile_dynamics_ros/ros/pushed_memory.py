"""What earlier pushes told of the object: where a node begins, and what it keeps."""

from __future__ import annotations

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.core.inertia.live.live_estimate import MISFIT
from tactile_dynamics_ros.core.planar.filter.live import LiveProperties
from tactile_dynamics_ros.core.planar.memory.combination import known_of, with_memory
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate
from tactile_dynamics_ros.recording.pushed.known_files import read_known, write_known
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.object_memory import MemoryFiles
from tactile_dynamics_ros.ros.shell import Shell

_FLOOR = 0.02
"""Least std of ln friction force and ln mass with which the filter begins: that of `live` after a
fit, since a tighter belief could not follow a table that differs."""


class PushMemory:
    """Combines fits with earlier recordings of the object, and writes what is known after each.

    The prior is read at the start and at every reset. With one name for `prior` and `save`, the
    file need not exist at first.

    Args:
        node: whose parameters `prior` and `save` name the files.
    """

    def __init__(self, node: Shell) -> None:
        self.files = MemoryFiles(node, read_known)
        self._node, self._prior = node, self.files.prior
        self._known = self.files.read()
        self._begun = False
        self._changed: list[str] = []

    def begin_anew(self) -> None:
        """Begin with what the file has now."""
        self._begun, self._changed = False, []
        self._known = self.files.read()

    def give_up(self) -> None:
        """What was known does not hold any longer: object or table have changed."""
        self._known = None

    def inform(self, live: LiveProperties) -> None:
        """Let the filter begin with what is known, once it follows the object."""
        known, tracker = self._known, live.tracker
        if known is None or self._begun or tracker is None or tracker.filter is None:
            return
        self._begun = True
        mean = known.values.copy()
        mean[0] -= np.log(-live.gravity[2])  # the filter's is a product of mass and friction
        tracker.filter.inform(mean, known.covariance + np.diag([_FLOOR**2, _FLOOR**2, 0.0, 0.0]))

    def combine(self, found: PushedEstimate) -> PushedEstimate:
        """Return a fit with what was known, or alone where it differs beyond chance."""
        before, self._changed = self._changed, []
        if self._known is not None:
            found, self._changed = with_memory(found, self._known)
        if self._changed and not before:
            self._node.faults.add("changed_object", self._sentence())
        self._keep(found)
        return found

    def statuses(self) -> list[DiagnosticStatus]:
        """Return what is said of the memory; nothing without a prior."""
        if self._known is None:
            return []
        count = self._known.recordings
        values = {"prior": self._prior, "recordings": count, "changed": ",".join(self._changed)}
        if self._changed:
            return [status_message("memory", values, DiagnosticStatus.WARN, self._sentence())]
        text = f"together with {count} recordings of {self._prior}"
        return [status_message("memory", values, DiagnosticStatus.OK, text)]

    def _sentence(self) -> str:
        return (
            f"{' and '.join(self._changed)} differ from {self._prior} beyond chance: object or "
            "table are others, or the frame lies otherwise; these pushes alone count"
        )

    def _keep(self, found: PushedEstimate) -> None:
        if not self.files.save or not found.is_answer or found.error >= MISFIT:
            return
        if self._changed and self.files.is_one:
            return  # the file is that of another object or table
        alone = self._known is None or bool(self._changed)
        count = 1 if alone or self._known is None else self._known.recordings + 1
        name = self._node.get_fully_qualified_name()
        self.files.write(known_of(found, name, count), write_known)
