"""What nodes keep over a restart: objects by name, the tare of fingertips."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.files import own_folder, written_whole
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.inertia.batch.knowledge import Comparison, with_memory
from tactile_dynamics_ros.core.inertia.live.live_estimate import MISFIT, Level, Verdict
from tactile_dynamics_ros.core.reading import require_file
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import KnownBody
from tactile_dynamics_ros.recording.yaml_files import read_body, write_body
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import Shell

Estimate = TypeVar("Estimate", bound=InertialEstimate)
Known = TypeVar("Known")

_LASTS = 3.0
"""Time that a difference beyond chance has to last, s, before the object is said to have changed:
the first samples of a grasp are few, the hand still slips, and inertias of two seconds of data are
off by more than they say. At 1 the same box was reported to have changed in two grasps of three;
more tells of a change later. Meanwhile this grasp alone is published."""
_SAVE_EVERY = 5.0
"""Time between writings, s of the stamps: what a crash may lose. A file of 3 kB costs nothing."""


@dataclass(frozen=True)
class MemoryConfig:
    """Files of what is known of the object."""

    prior: str = parameter("", "file of earlier grasps, as estimate --prior; empty: none")
    save: str = parameter("", "file that keeps what is known, as estimate --save; empty: none")


class MemoryFiles(Generic[Known]):
    """The files of a memory. One that cannot be read is counted and left as it is.

    The node then begins without a memory; where the file is also the one to save to, nothing is
    written until it can be read again or is taken away: it may hold what a person wants to mend.

    Args:
        node: whose parameters `prior` and `save` name the files.
        reader: of a file; raises BadInputError.
    """

    def __init__(self, node: Shell, reader: Callable[[str], Known]) -> None:
        config = declare_config(node, MemoryConfig)
        self._node, self._reader, self._refused = node, reader, False
        self.prior, self.save = config.prior, config.save

    @property
    def is_one(self) -> bool:
        """Whether one file is both read and written."""
        return bool(self.save) and Path(self.prior) == Path(self.save)

    def read(self) -> Known | None:
        """Return what the file of earlier recordings has; None where there is nothing to read."""
        self._refused = False
        if not self.prior or (self.is_one and not os.path.lexists(self.prior)):
            return None
        try:
            return self._reader(self.prior)
        except BadInputError as error:
            self._refused = True
            self._node.faults.add("prior_not_read", f"{error}; begun without it")
            return None

    def write(self, known: Known, writer: Callable[[Known, str], object]) -> None:
        """Write what is known, over an older file of this kind only."""
        if not self.save or (self._refused and self.is_one and os.path.lexists(self.save)):
            return
        try:
            writer(known, self.save)
        except BadInputError as error:
            self._node.faults.add("not_saved", str(error))


class ObjectMemory:
    """Combines an estimate with earlier grasps of the object, and writes what is known.

    The prior is read at the start and after every reset, so that a node whose `prior` and `save`
    are one file begins each grasp where the last ended. That file need not exist at first.

    Args:
        node: whose parameters `prior` and `save` name the files.
    """

    def __init__(self, node: Shell) -> None:
        self.files = MemoryFiles(node, read_body)
        self._node, self._prior = node, self.files.prior
        self._newest: KnownBody | None = None
        self._begin()

    def _begin(self) -> None:
        self._known = self.files.read()
        self._comparison: Comparison | None = None
        self._since: float | None = None
        self._told = False
        self._saved = -float("inf")

    def end_grasp(self) -> None:
        """Write what this grasp told; the next begins with what the file of the prior has then."""
        self._write()
        self._newest = None
        self._begin()

    def combine(self, estimate: Estimate, time: float) -> Estimate:
        """Return the estimate with what was known, or alone while it differs beyond chance.

        Args:
            estimate: of this grasp.
            time: s, of its newest sample.
        """
        if self._known is None:
            return estimate
        combined, self._comparison = with_memory(estimate, self._known)
        if not self._comparison.changed:
            self._since, self._told = None, False
            return combined  # type: ignore[return-value]
        self._since = time if self._since is None else self._since
        if self.changed(time) and not self._told:
            self._told = True
            self._node.faults.add("changed_object", self._sentence())
        return estimate

    def changed(self, time: float) -> bool:
        """Whether the object is another one than that of the prior."""
        return self._since is not None and time - self._since >= _LASTS

    def judged(self, verdict: Verdict, estimate: InertialEstimate) -> Verdict:
        """Return the verdict; what earlier grasps told need not be moved for again."""
        fits = estimate.error.whitened_rms < MISFIT
        if self._known is None or self._since is not None or not fits or estimate.not_excited:
            return verdict
        if verdict.level is not Level.WARN:
            return verdict
        return Verdict(Level.OK, f"known from {self._known.recordings} earlier grasps and this one")

    def keep(self, estimate: InertialEstimate, verdict: Verdict, time: float) -> None:
        """Keep an estimate that is an answer; written now and then, and when the grasp ends."""
        fits = estimate.error.whitened_rms < MISFIT
        if not self.files.save or verdict.withheld or not fits or "mass" in estimate.not_excited:
            return
        if self._known is not None and estimate.duration < _LASTS:
            return  # too early to say that it is the same object
        changed = self.changed(time)
        if changed and self.files.is_one:
            self._newest = None  # the file is that of another object
            return
        if self._since is not None and not changed:
            return
        alone = self._known is None or self._since is not None
        effects = {name: effect.to_json() for name, effect in estimate.effects.items()}
        self._newest = KnownBody(
            estimate.inertia.dynamic_parameters,
            estimate.covariance,
            self._node.get_fully_qualified_name(),
            estimate.not_excited,
            effects if alone or self._known is None else self._known.effects | effects,
            1 if alone or self._known is None else self._known.recordings + 1,
        )
        if time - self._saved > _SAVE_EVERY:
            self._write()
            self._saved = time

    def statuses(self, time: float) -> list[DiagnosticStatus]:
        """Return what is said of the memory; nothing without a prior."""
        if self._known is None or self._comparison is None:
            return []
        changed = self.changed(time)
        level = DiagnosticStatus.WARN if changed else DiagnosticStatus.OK
        before = f"together with {self._known.recordings} earlier grasps of {self._prior}"
        values: dict[str, object] = {
            "prior": self._prior,
            "recordings": self._known.recordings,
            "changed": ",".join(self._comparison.changed) if changed else "",
        }
        values |= {f"p_{name.replace(' ', '_')}": p for name, p in self._comparison.p_value.items()}
        return [status_message("memory", values, level, self._sentence() if changed else before)]

    def _sentence(self) -> str:
        assert self._comparison is not None
        return (
            f"{' and '.join(self._comparison.changed)} differ from {self._prior} beyond chance: "
            "the object has changed, or its frame lies otherwise in it; this grasp alone counts"
        )

    def _write(self) -> None:
        if self._newest is not None:
            self.files.write(self._newest, write_body)


class KeptTare:
    """Frames of the last tare in a file, so that a restarted node need not open the hand.

    Args:
        fingers: how many there are.
        path: path of the file; if empty, one per ROS domain and namespace in the user's own folder.
        namespace: namespace of the node, so that each of several hands has its own.

    Raises:
        BadInputError: there is no folder of this user alone.
    """

    def __init__(self, fingers: int, path: str = "", namespace: str = "/") -> None:
        self._shape = (fingers, 44)
        parts = [os.environ.get("ROS_DOMAIN_ID", "0"), *namespace.split("/")]
        name = "_".join(str(part) for part in ["biotac_tare", *parts] if part != "")
        self.path = Path(path) if path else own_folder() / f"{name}.npy"

    def read(self, max_age: float) -> NDArray[np.float64] | None:
        """Return the frames (K, F, 44), or None if none were in use within `max_age` seconds."""
        try:
            if time.time() - self.path.stat().st_mtime > max_age:
                return None
            frames = np.load(require_file(self.path))
        except (BadInputError, OSError, ValueError, EOFError):
            return None
        return frames if frames.ndim == 3 and frames.shape[1:] == self._shape else None

    def refresh(self) -> None:
        """Note that the tare is in use."""
        with contextlib.suppress(OSError):
            os.utime(self.path)

    def write(self, frames: NDArray[np.float64]) -> None:
        """Keep frames (K, F, 44)."""
        try:
            with written_whole(self.path) as part, part.open("wb") as stream:
                np.save(stream, frames)
        except BadInputError as error:
            raise NotIdentifiableError(f"tare cannot be kept: {error}") from error
