"""Contacts of fingertips put together, and friction as messages."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.friction.estimate import FrictionEstimate
from tactile_dynamics_ros.core.streams.stamps import Reordered
from tactile_dynamics_ros.core.streams.streams import ContactSample, places_at
from tactile_dynamics_ros.ros.conversions import MessageError, pose_to_core, wrench_to_core
from tactile_dynamics_ros.ros.diagnostics import status_message, status_values
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import contact_topic
from tactile_dynamics_ros.ros.robot import HandError
from tactile_dynamics_ros.ros.shell import Shell
from tactile_dynamics_ros.ros.stated_noise import read_force_std
from tactile_dynamics_ros.ros.stream_clock import StreamClock
from tactile_dynamics_ros.ros.wire import Stamped

NUMBERS = ("static", "std", "low", "high", "kinetic", "slips")
"""Keys of a region that are numbers."""


def estimate_status(
    found: dict[str, FrictionEstimate], final: bool, outcome: str
) -> DiagnosticStatus:
    """Return an estimate as message: keys `<region>.static`, `.low`, `.high`, `.kinetic` ..."""
    values: dict[str, object] = {"final": final, "regions": ",".join(found)}
    sentences = []
    for name, region in found.items():
        values |= {
            f"{name}.static": region.static,
            f"{name}.std": region.std,
            f"{name}.low": region.interval[0],
            f"{name}.high": region.interval[1],
            f"{name}.kinetic": region.kinetic,
            f"{name}.kinetic_std": region.kinetic_std,
            f"{name}.slips": region.slips,
            f"{name}.normal_moves": region.normal_moves,
        }
        low, high = region.interval
        sentence = f"{name}: {region.static:.3f} ({low:.3f} to {high:.3f})"
        sentences.append(sentence + ", its surface gives way" * region.normal_moves)
    moves = any(region.normal_moves for region in found.values())
    level = DiagnosticStatus.WARN if moves or outcome else DiagnosticStatus.OK
    text = "; ".join([*sentences, outcome] if outcome else sentences) or "no slip yet"
    return status_message("friction", values, level, text)


def estimate_document(values: dict[str, str], message: str) -> dict[str, Any]:
    """Return {"started", "message", "regions": {name: {"static", "interval", ...}}}."""
    regions = {}
    for name in [part for part in values.get("regions", "").split(",") if part]:
        number = {key: float(values[f"{name}.{key}"]) for key in NUMBERS}
        regions[name] = {
            "static": number["static"],
            "std": number["std"],
            "interval": [number["low"], number["high"]],
            "kinetic": None if number["kinetic"] != number["kinetic"] else number["kinetic"],
            "slips": int(number["slips"]),
            "normal_moves": values[f"{name}.normal_moves"] == "True",
        }
    return {"started": True, "message": message, "regions": regions}


def result_fields(regions: dict[str, Any]) -> dict[str, list[Any]]:
    """Return the arrays of the result of tactile_dynamics_msgs/Probe, one entry for each region."""
    found = list(regions.values())
    return {
        "regions": list(regions),
        "static_friction": [region["static"] for region in found],
        "std": [region["std"] for region in found],
        "low": [region["interval"][0] for region in found],
        "high": [region["interval"][1] for region in found],
        "kinetic": [math.nan if r["kinetic"] is None else r["kinetic"] for r in found],
    }


def friction_range(message: DiagnosticStatus) -> tuple[float, float] | None:
    """Return the least and the largest coefficient that a final estimate allows, or None.

    They are the ends of all regions' intervals: which region a finger touches is not known.
    """
    values = status_values(message)
    ends = [float(v) for key, v in values.items() if key.endswith((".low", ".high"))]
    return (min(ends), max(ends)) if values.get("final") == "True" and ends else None


WORLD = "world"
KEPT = 1000
"""Readings kept: a link that delivers in batches brings poses, then forces of the same seconds."""
TOLERANCE = 0.03
"""Distance of a force's stamp to a pose's beyond which they do not belong together, s."""
PATIENCE = 0.5
"""How long a force waits for the pose of its contact, in time of the streams, s."""

_UNSTATED = np.full(3, np.nan)
"""Stands among the standard deviations for one that cannot be meant."""

_Timed = list[tuple[float, Array]]


class ContactAssembly:
    """Puts together what belongs to one stamp and hands it on in the order of time.

    Forces wait until a pose of the same stamp or a later one has come, and for others that are
    late; a force without a pose nearer than 30 ms is counted and dropped.

    Args:
        node: that subscribes.
        name: of the contact.
        deliver: called with each assembled contact in the order of time.
        clock: of the node's streams.
        hand: whose error in the world is corrected, or None to take contacts as they are reported.
        held: whether the owner releases forces; if not, each goes as soon as its pose is there.
    """

    def __init__(
        self,
        node: Shell,
        name: str,
        deliver: Callable[[ContactSample], None],
        clock: StreamClock,
        hand: HandError | None = None,
        held: bool = False,
    ) -> None:
        self._node, self._name, self._deliver, self._hand = node, name, deliver, hand
        self._clock, self._held = clock, held
        clock.on_move.append(self.clear)
        self._pose_topic = contact_topic(name, "pose")
        self._force_topic = contact_topic(name, "force")
        self._std_topic = contact_topic(name, "force_std")
        self._forces = Reordered[Array](KEPT)
        self.clear()
        heard: tuple[tuple[type[Any], str, Callable[[Stamped], None], Need], ...] = (
            (PoseStamped, self._pose_topic, self._on_pose, Need.ONCE),
            (Vector3Stamped, self._std_topic, self._on_std, Need.OPTIONAL),
            (WrenchStamped, self._force_topic, self._on_force, Need.ONCE),
        )
        for kind, topic, callback, need in heard:
            node.listen(kind, topic, callback, skim=True, sole=True, need=need)

    @property
    def late(self) -> int:
        """Forces that came after a newer one and were put in their place."""
        return self._forces.late

    def clear(self) -> None:
        """Forget what waits."""
        self._forces.clear()
        self._poses: _Timed = []
        self._stds: _Timed = []

    def release(self, until: float) -> None:
        """Hand on the forces up to a time (s) whose poses have come."""
        newest = self._poses[-1][0] if self._poses else -np.inf
        late = self._forces.take(min(until, self._clock.newest - PATIENCE))
        for time, wrench in [*late, *self._forces.take(min(until, newest))]:
            place = self._place(time)
            if place is None:
                self._node.faults.add(
                    f"force_without_pose_{self._name}",
                    f"{self._force_topic}: no pose on {self._pose_topic} within {TOLERANCE} s",
                )
                continue
            self._deliver(self._assemble(time, wrench, *place))

    def _on_pose(self, message: Stamped) -> None:
        matrix = pose_to_core(message, self._pose_topic, WORLD)
        _insert(self._poses, self._clock.admit(message.stamp, self._pose_topic), matrix)
        self._release_soon()

    def _on_std(self, message: Stamped) -> None:
        std = read_force_std(message, self._std_topic, self._node.faults)
        time = self._clock.admit(message.stamp, self._std_topic)
        _insert(self._stds, time, _UNSTATED if std is None else std)

    def _on_force(self, message: Stamped) -> None:
        wrench = wrench_to_core(message, self._force_topic, WORLD)
        time = self._clock.admit(message.stamp, self._force_topic)
        if not self._forces.add(time, wrench):
            raise MessageError(
                "stamp_repeated",
                f"{self._force_topic}: stamp {time:.6f} s repeats or comes too late",
            )
        self._release_soon()

    def _release_soon(self) -> None:
        if not self._held:
            self.release(np.inf)

    def _place(self, time: float) -> tuple[Array, Array] | None:
        """The pose of that stamp, or `places_at` of those around it; None if both are too far."""
        after = bisect_left(self._poses, time, key=_stamp_of)
        if after < len(self._poses) and self._poses[after][0] == time:
            matrix = self._poses[after][1]
            return matrix[:3, 3], matrix[:3, :3]
        around = self._poses[max(after - 1, 0) : after + 1]
        stamps = np.array([stamp for stamp, _ in around])
        if np.min(np.abs(stamps - time), initial=np.inf) > TOLERANCE:
            return None
        poses = np.array([matrix for _, matrix in around])
        points, rotations = places_at(stamps, poses[:, :3, 3], poses[:, :3, :3], np.array([time]))
        return points[0], rotations[0]

    def _assemble(self, time: float, wrench: Array, point: Array, rotation: Array) -> ContactSample:
        after = bisect_right(self._stds, time + 1e-9, key=_stamp_of)
        std = self._stds[max(after - 1, 0)][1] if self._stds else _UNSTATED
        std = None if std is _UNSTATED else std
        contact = ContactSample(time, self._name, point, rotation, wrench[3:], wrench[:3], std)
        return contact if self._hand is None else contact.moved(self._hand.at(time))


def _insert(entries: _Timed, time: float, value: Array) -> None:
    """Insert in the order of time; a repeated stamp is left out, the oldest beyond `KEPT` go."""
    if not entries or time > entries[-1][0]:
        entries.append((time, value))
    elif entries[min(bisect_left(entries, time, key=_stamp_of), len(entries) - 1)][0] != time:
        insort(entries, (time, value), key=_stamp_of)
    if len(entries) > 2 * KEPT:
        del entries[:KEPT]


def _stamp_of(entry: tuple[float, Array]) -> float:
    return entry[0]
