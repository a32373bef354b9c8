"""Changes of messages that many faults of streams share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from benchmarks.replay.tape import Message

Change = Callable[[list[Message]], Iterable[Message]]


def each(change: Callable[[Message], Message | None], **where: str) -> Change:
    """Change each message whose attributes are as given; None takes it away."""

    def changed(messages: list[Message]) -> Iterator[Message]:
        for message in messages:
            if any(getattr(message, key) != value for key, value in where.items()):
                yield message
                continue
            found = change(message)
            if found is not None:
                yield found

    return changed


def shifted(amount_ns: int, **where: str) -> Change:
    return each(lambda m: replace(m, stamp_ns=m.stamp_ns + amount_ns), **where)


def scaled(factor: float, *streams: str) -> Change:
    """Multiply the forces, or what is stated of them."""

    def scale(message: Message) -> Message:
        inside = message.stream in streams
        return replace(message, values=factor * message.values) if inside else message

    return each(scale)


def put(value: float, index: int, **where: str) -> Change:
    """Set one of the doubles of a message."""

    def put(message: Message) -> Message:
        values = message.values.copy()
        values[index] = value
        return replace(message, values=values)

    return each(put, **where)


def constant(**where: str) -> Change:
    """Repeat the values of the first message of each topic, with fresh stamps."""
    return repeated(lambda message, first: replace(message, values=first.values), **where)


def frozen(**where: str) -> Change:
    """Repeat the first message of each topic, with its stamp."""
    return repeated(lambda message, first: replace(first, due=message.due), **where)


def repeated(join: Callable[[Message, Message], Message], **where: str) -> Change:
    def changed(messages: list[Message]) -> Iterable[Message]:
        first: dict[str, Message] = {}
        return each(lambda m: join(m, first.setdefault(m.topic, m)), **where)(messages)

    return changed
