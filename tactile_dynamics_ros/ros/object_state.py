"""What a node hears of the object now: it waits for an input, follows the object, or lost it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.names import OBJECT_FOOTPRINT, OBJECT_POSE, PUSHER_POSE

SILENT = 1.3
"""Wall time without a message after which an input counts as silent, s. Streams of 1 Hz still
count as coming, and a status says within two seconds that nothing comes, since messages are put in
order and looked at for up to 0.6 s. Less would take a busy
machine's pauses for silence, more would leave a status OK for longer."""

REPEAT = 1.0
"""Wall time between statuses while nothing new is known, s: statuses are latched, and one that is
older than two seconds may say of the object what no longer holds. More often costs messages."""

DROPPED = 10.0
"""Wall time for which a contact that fell silent while it pressed is suspicious, s, as the
estimator doubts it (`contact_queue._DOUBT_DURATION`): later it is taken for lifted. Silence instead
of zero forces is allowed; longer would warn of a finger that was lifted."""

WAITING, HELD, RELEASED, FOLLOWED = "waiting", "held", "nothing held", "followed"


@dataclass(frozen=True)
class ObjectState:
    """What a node hears of the object at one time.

    Attributes:
        name: waiting, held, nothing held, or followed (a pushed object whose pose comes).
        lasts: s, for how long.
        text: for people.
        troubles: what is wrong with the inputs although the object is held or followed.
    """

    name: str
    lasts: float
    text: str
    troubles: tuple[str, ...] = ()

    @property
    def current(self) -> bool:
        """Whether what the object does now is heard."""
        return self.name in (HELD, FOLLOWED)

    @property
    def warning(self) -> str:
        """Why what is known of the object may not be of now; empty if there is no reason."""
        return "; ".join([*([] if self.current else [self.text]), *self.troubles])

    def status(self, age: float) -> DiagnosticStatus:
        """Return the status "state"; WARN unless current and all that is needed comes.

        Args:
            age: s, since the estimate was renewed last; infinity before the first.
        """
        level = DiagnosticStatus.WARN if self.warning else DiagnosticStatus.OK
        values: dict[str, object] = {"state": self.name, "lasts": round(self.lasts, 3)}
        if math.isfinite(age):
            values["age"] = round(age, 3)
        return status_message("state", values, level, self.warning or self.text)


class Holding:
    """Whether an object is held, since when, or since when not.

    Held means that its pose comes and some contact touches it. All times are monotonic, s.

    Args:
        contacts: their names.
        now: when listening begins.
    """

    def __init__(self, contacts: Sequence[str], now: float) -> None:
        self._contacts = tuple(contacts)
        self.clear(now)

    def clear(self, now: float) -> None:
        """Begin to listen anew."""
        self._begun, self._pose, self._touched = now, -math.inf, -math.inf
        self._contact = -math.inf
        self._pressing: dict[str, float] = {}
        self._last: dict[str, tuple[float, bool]] = {}
        self._tells: set[str] = set()
        self._since = self._until = math.nan

    def hear_pose(self, now: float) -> None:
        """Note that a pose of the object came."""
        held = self._holds(now)
        self._pose = now
        self._note(held, now)

    def hear_contact(self, name: str, touches: bool, now: float) -> None:
        """Note that a contact was heard, and whether it touches the object."""
        held = self._holds(now)
        self._contact = now
        self._last[name] = now, touches
        if touches:
            self._touched = self._pressing[name] = now
        else:
            self._tells.add(name)
        self._note(held, now)

    def state(self, now: float) -> ObjectState:
        """Return what is heard of the object."""
        if self._holds(now):
            return ObjectState(HELD, now - self._since, "held", self._dropped(now))
        if now - self._touched <= SILENT and math.isfinite(self._pose):
            pressing = [name for name, at in self._pressing.items() if now - at <= SILENT]
            lasts = now - self._pose
            text = f"waiting for {OBJECT_POSE}, silent since {lasts:.0f} s"
            return ObjectState(WAITING, lasts, f"{text}; touching: {', '.join(pressing)}")
        if math.isnan(self._until):
            return ObjectState(WAITING, now - self._begun, f"waiting for {self._missing(now)}")
        lasts = now - self._until
        silent = "; contacts are silent" if now - self._contact > SILENT else ""
        return ObjectState(RELEASED, lasts, f"nothing held since {lasts:.0f} s{silent}")

    def _holds(self, now: float) -> bool:
        return now - min(self._pose, self._touched) <= SILENT

    def _dropped(self, now: float) -> tuple[str, ...]:
        """Name the contacts that fell silent while they pressed, or that else tell of no touch."""
        found = []
        for name, (at, touched) in self._last.items():
            silent = f"contact/{name}: silent since {now - at:.0f} s"
            if touched and SILENT < now - at <= DROPPED:
                found.append(f"{silent}, it pressed before")
            elif name in self._tells and now - at > SILENT:
                found.append(f"{silent}, where it told of no touch by zeros before")
        return tuple(found)

    def _note(self, held: bool, now: float) -> None:
        """Note when holding began, and until when it surely lasted."""
        if not self._holds(now):
            return
        self._since = self._since if held else now
        self._until = min(self._pose, self._touched)

    def _missing(self, now: float) -> str:
        """Name the inputs that never came, or what they lack."""
        missing = [] if math.isfinite(self._pose) else [OBJECT_POSE]
        if not math.isfinite(self._contact):
            missing += [f"contact/{name}" for name in self._contacts]
        if missing:
            return ", ".join(missing)
        if now - self._pose > SILENT:
            return f"{OBJECT_POSE}, silent since {now - self._pose:.0f} s"
        return "a touch: no contact presses"


class Following:
    """Whether a pushed object is followed. Contacts that are silent are normal there.

    All times are monotonic, s.

    Args:
        now: when listening begins.
    """

    def __init__(self, now: float) -> None:
        self.clear(now)

    def clear(self, now: float) -> None:
        """Begin to listen anew."""
        self._begun = self._since = now
        self._heard = {OBJECT_POSE: -math.inf, PUSHER_POSE: -math.inf}
        self._touched = -math.inf

    def hear(self, topic: str, now: float) -> None:
        """Note that a pose of the object or of the pusher came."""
        if not self._follows(now):
            self._since = now
        self._heard[topic] = now

    def hear_touch(self, now: float) -> None:
        """Note that a contact pushes or pulls the object."""
        self._touched = now

    def state(self, now: float, outlined: bool) -> ObjectState:
        """Return what is heard of the object.

        Args:
            now: s.
            outlined: whether its footprint has come.
        """
        if outlined and self._follows(now):
            touched = now - self._touched
            text = f"last touched {touched:.0f} s ago" if math.isfinite(touched) else "not touched"
            return ObjectState(FOLLOWED, now - self._since, f"followed, {text}")
        never = [] if outlined else [OBJECT_FOOTPRINT]
        never += [topic for topic, at in self._heard.items() if not math.isfinite(at)]
        if never:
            return ObjectState(WAITING, now - self._begun, f"waiting for {', '.join(never)}")
        lasts = now - min(self._heard.values())
        silent = [topic for topic, at in self._heard.items() if now - at > SILENT]
        text = f"waiting for {', '.join(silent)}, silent since {lasts:.0f} s"
        return ObjectState(WAITING, lasts, text)

    def _follows(self, now: float) -> bool:
        return now - min(self._heard.values()) <= SILENT
