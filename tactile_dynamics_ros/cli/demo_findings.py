"""What the demo with a hidden effect found: live, from the recording, and what was hidden."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.discrepancy.verdict.wording import join_names

Document = dict[str, Any]

_NOTHING = "nothing is missing"
_UNKNOWN = "something is missing that is not in the catalogue"


@dataclass(frozen=True)
class Findings:
    """What was said to be missing from the model of a rigid body.

    Attributes:
        live: document of the diagnosis of the running nodes; None if none came.
        seconds: span of the measurements of that diagnosis, s.
        offline: document of the explanation of the whole recording; None if there is none.
    """

    live: Document | None
    seconds: float
    offline: Document | None

    @property
    def effects(self) -> list[str]:
        """Effects of the explanation."""
        return self.offline["effects"] if self.offline else []

    def summary(self, whole: float, hidden: Mapping[str, Any]) -> list[str]:
        """Return how live and offline go together, and what was hidden, a sentence each.

        Args:
            whole: span of the measurements of the recording, s.
            hidden: the hidden effect, as robot_sim reveals it.
        """
        return [self._agreement(whole), self._reveal(hidden)]

    def sentences(self, whole: float, hidden: Mapping[str, Any]) -> list[str]:
        """Return the whole story for the report; arguments as those of `summary`."""
        story = []
        if self.live:
            story.append(f"Live, from the first {self.seconds:.0f} s: {self.live['sentence']}")
        if self.offline:
            story.append(f"From all {whole:.0f} s of the recording: {self.offline['sentence']}")
            story += doubts(self.offline)
        return story + self.summary(whole, hidden)

    def _agreement(self, whole: float) -> str:
        if self.live is None or self.live["verdict"] == "none":
            return "Live there was no diagnosis."
        if self.offline is None:
            return "The recording could not be explained; see what was said live."
        said, found = _said_live(self.live), _said_offline(self.offline)
        alike = _named(self.live) == _named(self.offline) and self.offline["verdict"] == "adequate"
        if said == found or (alike and _named(self.live)):
            return f"Live and offline agree: {said}."
        return (
            f"Live, from the first {self.seconds:.0f} s: {said}; offline, from all {whole:.0f} s: "
            f"{found}. {_why_unlike(self.live, self.offline)}"
        )

    def _reveal(self, hidden: Mapping[str, Any]) -> str:
        name = hidden["name"]
        live = self.live is not None and name in _named(self.live)
        offline = self.offline is not None and name in _named(self.offline)
        where = [word for word, found in (("live", live), ("offline", offline)) if found]
        values = ", ".join(f"{key} {_value(entry)}" for key, entry in hidden["parameters"].items())
        named = f"named {join_names(where, 'and')}" if where else "named neither live nor offline"
        return f"Hidden effect: {name} ({values}); {named}."


def doubts(document: Document) -> list[str]:
    """Return a sentence for each effect of an explanation that others could stand for.

    Args:
        document: of an explanation.
    """
    return [
        f"This recording cannot tell {name} from "
        f"{join_names([other for other in group if other != name])}: mass, centre of mass and "
        f"inertia hold if it is {name}."
        for name, group in document["groups"].items()
    ]


def _named(document: Document) -> set[str]:
    """Return the effects that a document names, alone or among others, without their regimes."""
    groups = document.get("groups", {}).values()
    names = [document.get("effect"), *document.get("group", ()), *document.get("effects", ())]
    names += [name for group in groups for name in group]
    return {name.partition("[")[0] for name in names if name}


def _said_live(document: Document) -> str:
    if document["verdict"] == "ambiguous":
        return join_names(document["group"])
    kinds = {"adequate": _NOTHING, "convention": "the recording is to be read otherwise"}
    return document["effect"] or kinds.get(document["verdict"], _UNKNOWN)


def _said_offline(document: Document) -> str:
    named = [join_names(document["groups"].get(n, [n])) for n in document["effects"]]
    if document["verdict"] == "adequate":
        return join_names(named, "and") or _NOTHING
    if not named:
        return _UNKNOWN
    return f"{join_names(named, 'and')}, and something else remains"


def _why_unlike(live: Document, offline: Document) -> str:
    """Return how two answers that differ go together."""
    if _named(live) & _named(offline):
        return "They have a name in common; more of the motion tells more of it."
    return "Both ask the same question; offline has more of the motion, and counts."


def _value(entry: Mapping[str, Any]) -> str:
    numbers = np.ravel(entry["value"])
    text = ", ".join(f"{number:.3g}" for number in numbers)
    return f"{f'({text})' if len(numbers) > 1 else text} {entry['unit']}".strip()
