"""Recordings of hands in namespaces: /left/object/pose is what /object/pose is at root."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording import topics
from tactile_dynamics_ros.recording.bag_files import BagTables

ROOT = ""


def absolute_namespace(text: str) -> str:
    """Return a namespace with a leading slash and none at the end; "" is root."""
    return "/" + text.strip("/") if text.strip("/") else ROOT


def split_topic(topic: str, known: re.Pattern[str]) -> tuple[str, str] | None:
    """Return namespace and name at root of a topic whose name at root is known, else None.

    Args:
        topic: as it was recorded.
        known: matches whole names at root.
    """
    start = 0
    while start >= 0:
        if known.fullmatch(topic, start):
            return topic[:start], topic[start:]
        start = topic.find("/", start + 1)
    return None


def is_of_robot(names: Iterable[str]) -> bool:
    """Whether topics are those of a robot alone: there are some, and none is of a recording."""
    found = list(names)
    return bool(found) and not any(split_topic(topic, topics.NEEDED) for topic in found)


def inside(topic: str, namespace: str) -> str | None:
    """Return a topic's name as a node in the namespace would write it at root; None if outside."""
    return topic[len(namespace) :] if topic.startswith(f"{namespace}/") else None


def choose_namespace(
    given: str | None, found: Iterable[str], root_is_used: bool, source: str
) -> str:
    """Return the namespace that is read: the one that is given, root, or the only one.

    Args:
        given: by the user, or None.
        found: namespaces that hold all that is needed.
        root_is_used: whether anything that is needed was recorded at root.
        source: for error texts.

    Raises:
        BadInputError: there are several, or not the given one; names all that there are.
    """
    names = sorted(set(found) - {ROOT})
    if given is not None:
        namespace = absolute_namespace(given)
        if namespace not in (ROOT, *names):
            raise BadInputError(
                f"namespace {namespace}: {source} has none of the topics needed there; there "
                f"{'is' if len(names) == 1 else 'are'} {', '.join(names) or 'only those at root'}"
            )
        return namespace
    if root_is_used or not names:
        return ROOT
    if len(names) > 1:
        raise BadInputError(
            f"{source} holds nothing at root but several namespaces: {', '.join(names)}; "
            f"choose one, as in --namespace {names[0].lstrip('/')}"
        )
    return names[0]


@dataclass(frozen=True)
class RecordedNames:
    """Names that recorded topics stand for: what the user says, else those inside a namespace.

    Attributes:
        remap: recorded topics and the names at root that they stand for, one or several.
        namespace: that is read; None chooses root or the only one.
        needed: matches names at root of the topics that a recording is made of.
        suffice: whether topics at root are enough for a recording.
    """

    remap: Mapping[str, str | Sequence[str]]
    namespace: str | None = None
    needed: re.Pattern[str] = topics.NEEDED
    suffice: Callable[[Iterable[str]], bool] = topics.suffice

    def may_be_needed(self, topic: str) -> bool:
        """Whether a topic may have to be read, before it is known which there are."""
        if topic in self.remap:
            return any(map(self.needed.fullmatch, self._meant(topic)))
        found = split_topic(topic, self.needed)
        return found is not None and self._may_be(found[0])

    def _meant(self, recorded: str) -> tuple[str, ...]:
        """Names that a remapped topic stands for: a sensor's pose may be the object's too."""
        names = self.remap[recorded]
        return (names,) if isinstance(names, str) else tuple(names)

    def _may_be(self, namespace: str) -> bool:
        return self.namespace is None or absolute_namespace(self.namespace) == namespace

    def recorded(self, meant: str, namespace: str) -> str:
        """Return the name under which a topic was recorded."""
        named = (topic for topic in self.remap if meant in self._meant(topic))
        return next(named, namespace + meant)

    def apply(self, bag: BagTables, source: str) -> str:
        """Give all topics the names that they stand for, all at once: names may be swapped.

        Returns:
            The namespace that is read; the topics outside it are gone.

        Raises:
            BadInputError: a topic or the namespace is not there, or there are several.
        """
        for recorded in self.remap:
            if recorded not in bag.types:
                present = ", ".join(sorted(bag.types))
                raise BadInputError(f"remap: {recorded} is not in {source} (topics: {present})")
        namespace = self._choose(bag.types, source)
        own = {t: inside(t, namespace) for t in bag.types if t not in self.remap}
        names = [(t, name) for t, name in own.items() if name is not None]
        names += [(t, name) for t in self.remap for name in self._meant(t)]
        bag.types = {meant: bag.types[t] for t, meant in names}
        bag.tables = {meant: bag.tables[t] for t, meant in names if t in bag.tables}
        if namespace != ROOT and self.namespace is None:
            bag.problems[f"no topic at root; read from the only namespace, {namespace}"] += 1
        return namespace

    def _choose(self, types: Iterable[str], source: str) -> str:
        """Return the namespace that is read."""
        found: dict[str, set[str]] = {}
        for topic in types:
            split = None if topic in self.remap else split_topic(topic, self.needed)
            if split is not None:
                found.setdefault(split[0], set()).add(split[1])
        meant = [name for topic in self.remap for name in self._meant(topic)]
        root_is_used = ROOT in found or any(map(self.needed.fullmatch, meant))
        enough = [name for name, own in found.items() if self.suffice(own)]
        wanted = enough if self.namespace is None else found
        return choose_namespace(self.namespace, wanted, root_is_used, source)
