"""Faults of a robot's topics, each a change of the messages of a clean recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter

import numpy as np

from benchmarks.replay.changes import Change, constant, each, frozen, put, scaled, shifted
from benchmarks.replay.tape import NANOSECONDS, Message
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, matrix_to_quaternion
from tactile_dynamics_ros.core.rigid_body.rotation import quaternion_to_matrix as to_matrix

HOUR_NS = 3600 * NANOSECONDS
FINGER = "ring"
"""The finger that is at fault."""
FORCE_OF_FINGER, POSE_OF_FINGER = f"/contact/{FINGER}/force", f"/contact/{FINGER}/pose"
SHUFFLED = 3
"""Frames within which the order is lost."""
RIVAL = "rival"
_RIVAL_SHIFT = np.array([0.05, -0.03, 0.02])
"""Offset of the second publisher's poses, m."""
_RIVAL_TURN = np.array([0.2, -0.1, 0.3])
"""Rotation vector of the same, rad."""


@dataclass(frozen=True)
class StreamFault:
    """A fault of the streams from its start to its end.

    Attributes:
        name: for the table.
        change: of the messages that are due during the fault.
        shift_ns: by which the clock of all messages stays shifted afterwards.
        once: only the first frame of the fault is changed.
        whole: the data are at fault from the beginning and until the fault's end.
        lossless: nothing has to be said if no sample is lost.
        withheld: nobody can know what is right, so that no interval may be published.
        anew: the nodes are started anew before.
        forgotten: the past is void afterwards, so that a diagnosis must find nothing.
    """

    name: str
    change: Change
    shift_ns: int = 0
    once: bool = False
    whole: bool = False
    lossless: bool = False
    withheld: bool = False
    anew: bool = False
    forgotten: bool = False

    def inject(self, messages: Iterable[Message], start: float, stop: float) -> list[Message]:
        """Return the messages with the fault from `start` to before `stop`, s, as they are due."""
        start = 0.0 if self.whole else start
        before, during, after = _cut(messages, start, stop)
        if self.once:
            head = [m for m in during if m.stamp_ns == during[0].stamp_ns]
            during = [*self.change(head), *during[len(head) :]]
        else:
            during = list(self.change(during))
        if self.shift_ns:
            after = list(shifted(self.shift_ns)(after))
        return sorted([*before, *during, *after], key=attrgetter("due"))


def _cut(
    messages: Iterable[Message], start: float, stop: float
) -> tuple[list[Message], list[Message], list[Message]]:
    """Return what is due before, during and after a span."""
    parts: tuple[list[Message], list[Message], list[Message]] = ([], [], [])
    for message in messages:
        parts[(message.due >= start - 1e-9) + (message.due >= stop - 1e-9)].append(message)
    return parts


def _unequal_jump(messages: list[Message]) -> Iterator[Message]:
    """Let the clock of the fingers jump, and that of the poses half a tenth of a second later."""
    late = messages[0].due + 0.05
    for message in messages:
        jumped = message.finger or message.due >= late
        yield replace(message, stamp_ns=message.stamp_ns - HOUR_NS) if jumped else message


def _stick_in_sensor(messages: list[Message]) -> Iterator[Message]:
    """Let the finger's sensor repeat what it read first: constant in the contact's axes."""
    turns = {m.stamp_ns: to_matrix(m.values[3:7]) for m in messages if m.topic == POSE_OF_FINGER}
    reading: np.ndarray | None = None
    for message in messages:
        if message.topic != FORCE_OF_FINGER or message.stamp_ns not in turns:
            yield message
            continue
        turn = turns[message.stamp_ns]
        if reading is None:
            reading = turn.T @ message.values[:3]
        yield replace(message, values=np.concatenate([turn @ reading, message.values[3:]]))


def _zero_force(message: Message) -> Message:
    return replace(message, values=np.zeros_like(message.values))


def _shuffle(messages: list[Message]) -> Iterator[Message]:
    """Permute the frames within groups of three; each is due when another would be."""
    frames = [list(frame) for _, frame in groupby(messages, attrgetter("stamp_ns"))]
    rng = np.random.default_rng(0)
    for start in range(0, len(frames), SHUFFLED):
        group = frames[start : start + SHUFFLED]
        dues = [frame[0].due for frame in group]
        for due, chosen in zip(dues, rng.permutation(len(group)), strict=True):
            yield from (replace(message, due=due) for message in group[chosen])


def _batch(messages: list[Message]) -> Iterator[Message]:
    """Hold messages back and send those of each second together."""
    start = messages[0].due
    return (replace(m, due=start + 1.0 + np.floor(m.due - start + 1e-9)) for m in messages)


def _add_rival(messages: list[Message]) -> Iterator[Message]:
    """Let a second publisher send other poses, 4 ms after the first one's."""
    for message in messages:
        yield message
        if message.stream == "object":
            values = message.values.copy()
            values[:3] += _RIVAL_SHIFT
            turned = exp_so3(_RIVAL_TURN) @ to_matrix(values[3:7])
            values[3:7] = matrix_to_quaternion(turned)
            yield replace(
                message,
                due=message.due + 0.004,
                stamp_ns=message.stamp_ns + 4_000_000,
                values=values,
                sender=RIVAL,
            )


def _zero_stamp(message: Message) -> Message:
    return replace(message, stamp_ns=0, absolute=True)


def _bad_text(message: Message) -> Message:
    """Put bytes that are no UTF-8 into the frame's name."""
    return replace(message, garble=lambda raw: raw.replace(b"world", b"w\xff\xfeld"))


def _cut_short(messages: list[Message]) -> Iterator[Message]:
    """Cut each message: inside the header, behind it, and inside the doubles, in turn."""
    for n, message in enumerate(messages):
        keep = (6, 15, 30, 45)[n % 4]
        yield replace(message, garble=lambda raw, keep=keep: raw[:keep])


_TINY_STD = each(lambda m: replace(m, values=np.full(3, 1e-9)), stream="force_std")

STREAM_FAULTS = (
    StreamFault("force_1e10", put(1e10, 0, stream="force", finger=FINGER), once=True),
    StreamFault("force_1e300", put(1e300, 0, stream="force", finger=FINGER), once=True),
    StreamFault("pose_1e8", put(1e8, 0, stream="object"), once=True),
    StreamFault("contact_point_1e8", put(1e8, 0, stream="pose", finger=FINGER), once=True),
    StreamFault("clock_back_1h", shifted(-HOUR_NS), -HOUR_NS, forgotten=True),
    StreamFault("clocks_back_1h_unequally", _unequal_jump, -HOUR_NS, forgotten=True),
    StreamFault("frame_ahead_1h", shifted(HOUR_NS, finger=FINGER), once=True),
    StreamFault("force_ahead_1h", shifted(HOUR_NS, finger=FINGER, stream="force"), once=True),
    StreamFault("contact_pose_ahead_1h", shifted(HOUR_NS, finger=FINGER, stream="pose"), once=True),
    StreamFault("pose_ahead_1h", shifted(HOUR_NS, stream="object"), once=True),
    StreamFault("finger_ahead_1h", shifted(HOUR_NS, finger=FINGER)),
    StreamFault("shuffled", _shuffle),
    StreamFault("finger_silent", each(lambda m: None, finger=FINGER)),
    StreamFault("finger_stuck", constant(finger=FINGER, stream="force")),
    StreamFault("finger_stuck_in_sensor", _stick_in_sensor),
    StreamFault("finger_frozen", frozen(finger=FINGER)),
    StreamFault("finger_zero", each(_zero_force, finger=FINGER, stream="force")),
    StreamFault("pose_frozen", constant(stream="object")),
    StreamFault("second_publisher", _add_rival, withheld=True),
    StreamFault("no_contact_poses", each(lambda m: None, stream="pose")),
    StreamFault("zero_stamps", each(_zero_stamp)),
    StreamFault("batches_1s", _batch, lossless=True),
    StreamFault("force_std_1e-9", _TINY_STD),
    StreamFault("forces_mn", scaled(1e3, "force", "force_std")),
    StreamFault("forces_mn_std_in_n", scaled(1e3, "force")),
    StreamFault("forces_flipped", scaled(-1.0, "force")),
    StreamFault("invalid_utf8", each(_bad_text)),
    StreamFault("short_cdr", _cut_short),
    StreamFault("shuffled_always", _shuffle, whole=True),
    StreamFault("force_std_1e-9_always", _TINY_STD, whole=True),
    StreamFault("forces_mn_always", scaled(1e3, "force", "force_std"), whole=True),
    StreamFault("forces_mn_std_in_n_always", scaled(1e3, "force"), whole=True),
    StreamFault("forces_flipped_always", scaled(-1.0, "force"), whole=True),
)
