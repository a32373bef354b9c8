"""Changes of messages that many faults of streams share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from benchmarks.replay.tape import Message
from tactile_dynamics_ros.core.array import Array

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
    """Shift the stamps."""
    return each(lambda m: replace(m, stamp_ns=m.stamp_ns + amount_ns), **where)


def scaled(factor: float, *streams: str) -> Change:
    """Multiply the forces, or what is stated of them."""

    def scale(message: Message) -> Message:
        inside = message.stream in streams
        return replace(message, values=factor * message.values) if inside else message

    return each(scale)


def put(value: float, index: int, **where: str) -> Change:
    """Set one of the doubles of a message."""

    def changed(message: Message) -> Message:
        values = message.values.copy()
        values[index] = value
        return replace(message, values=values)

    return each(changed, **where)


def constant(**where: str) -> Change:
    """Repeat the values of the first message of each topic, with fresh stamps."""
    return repeated(lambda message, first: replace(message, values=first.values), **where)


def frozen(**where: str) -> Change:
    """Repeat the first message of each topic, with its stamp."""
    return repeated(lambda message, first: replace(first, due=message.due), **where)


def repeated(join: Callable[[Message, Message], Message], **where: str) -> Change:
    """Join each message with the first one of its topic."""

    def changed(messages: list[Message]) -> Iterable[Message]:
        first: dict[str, Message] = {}
        return each(lambda m: join(m, first.setdefault(m.topic, m)), **where)(messages)

    return changed


def numbers(change: Callable[[Array], Array], **where: str) -> Change:
    """Change the doubles of messages."""
    return each(lambda m: replace(m, values=change(m.values.copy())), **where)


def framed(frame_id: str, **where: str) -> Change:
    """Put another frame into the header."""
    return each(lambda m: replace(m, frame_id=frame_id), **where)


def garbled(garble: Callable[[bytes], bytes], **where: str) -> Change:
    """Change the bytes of messages."""
    return each(lambda m: replace(m, garble=garble), **where)


def delayed(seconds: float, **where: str) -> Change:
    """Send messages later; they keep their stamps."""
    return each(lambda m: replace(m, due=m.due + seconds), **where)


def silent(**where: str) -> Change:
    """Take messages away."""
    return each(lambda m: None, **where)


def thinned(keep: Callable[[int], bool], **where: str) -> Change:
    """Keep those messages of each topic whose running number is to be kept."""

    def changed(messages: list[Message]) -> Iterable[Message]:
        count: Counter[str] = Counter()

        def take(message: Message) -> Message | None:
            count[message.topic] += 1
            return message if keep(count[message.topic]) else None

        return each(take, **where)(messages)

    return changed


def doubled(times: int = 2, sender: str = "", after: float = 0.0, **where: str) -> Change:
    """Send each message several times, the others by another sender and a little later, s."""

    def changed(messages: list[Message]) -> Iterator[Message]:
        for message in messages:
            yield message
            if all(getattr(message, key) == value for key, value in where.items()):
                again = replace(message, due=message.due + after, sender=sender)
                yield from [again] * (times - 1)

    return changed
