"""Types of command line options: numbers with their range, lists of numbers, paths to write to."""

from __future__ import annotations

import math
import tempfile
from argparse import ArgumentTypeError
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Number:
    """A finite number of an option; argparse calls it with the text that was typed.

    Attributes:
        low: smallest value, or the value above which it has to lie.
        high: largest value.
        above: whether `low` itself is refused.
        whole: whether only whole numbers are meant.
    """

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    whole: bool = False

    def __call__(self, text: str) -> float:
        """Return the number.

        Raises:
            ArgumentTypeError: it is none, is not finite, or lies outside the range.
        """
        try:
            value = int(text) if self.whole else float(text)
            inside = math.isfinite(value) and self.low <= value <= self.high
        except (ValueError, OverflowError):  # no number, or one of hundreds of digits
            inside = False
        if not inside or (self.above and value == self.low):
            raise ArgumentTypeError(f"'{text}', expected {self}")
        return value

    def __str__(self) -> str:
        """The range in words."""
        noun = "a whole number" if self.whole else "a number"
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"{noun} from {self.low:.10g} to {self.high:.10g}" + (
                f", not {self.low:.10g} itself" * self.above
            )
        if math.isfinite(self.low):
            return f"{noun} {'above' if self.above else 'of at least'} {self.low:.10g}"
        if math.isfinite(self.high):
            return f"{noun} of at most {self.high:.10g}"
        return "a finite number"


@dataclass(frozen=True)
class Numbers:
    """Finite numbers with commas between them, as Q1,Q2,..; argparse calls it with the text.

    Attributes:
        each: range of every one.
        count: how many there have to be; None for any number.
    """

    each: Number
    count: int | None = None

    def __call__(self, text: str) -> list[float]:
        """Return the numbers.

        Raises:
            ArgumentTypeError: one is none or outside the range, or there are not so many.
        """
        try:
            values = [self.each(part) for part in text.split(",")]
        except ArgumentTypeError:
            values = []
        if not values or self.count not in (None, len(values)):
            raise ArgumentTypeError(f"'{text}', expected {self}")
        return values

    def __str__(self) -> str:
        """What is expected, in words."""
        count = "numbers" if self.count is None else f"{self.count} numbers"
        return f"{count} with commas between them, each {self.each}"


FINITE = Number()
"""Any number: places, angles and offsets, which have a sign."""
POSITIVE = Number(0.0, above=True)
"""Sizes and times without which there would be nothing: masses, durations, speeds."""
NOT_NEGATIVE = Number(0.0)
"""Sizes that may be absent: 0 switches an effect off."""
COUNT = Number(1, whole=True)
"""How many of something there are, at least one."""
COUNT_OR_NONE = Number(0, whole=True)
"""The same where none is an answer, and numbers that count from 0."""
SEED = Number(0, 2**31 - 1, whole=True)
"""Seeds that every random generator of the package takes, those behind a ROS parameter too."""
FREE_PORT = Number(1, 65535, whole=True)
"""Numbers of TCP ports that one can name."""
PORT = Number(0, 65535, whole=True)
"""The same with 0, for which the system chooses a port that is free."""


def span(text: str) -> tuple[float, float]:
    """Return START and STOP of "START,STOP"; STOP may be `inf`.

    Raises:
        ArgumentTypeError: they are no such numbers, or START is not before STOP.
    """
    try:
        start, stop = (float(part) for part in text.split(","))
    except ValueError:
        raise ArgumentTypeError(f"'{text}', expected two numbers START,STOP in seconds") from None
    if not (math.isfinite(start) and start < stop):
        raise ArgumentTypeError(f"'{text}', expected START before STOP, in seconds")
    return start, stop


def path_to_write(text: str) -> str:
    """Return the path of a file or folder that can be written, after a try beside it.

    Raises:
        ArgumentTypeError: nothing can be written at the place.
    """
    path = Path(text).absolute()
    if not text:
        raise ArgumentTypeError("the path is empty, expected one to write to")
    places = [path, *path.parents] if path.is_dir() else path.parents
    folder = next(place for place in places if place.exists())
    try:
        with tempfile.TemporaryFile(dir=folder):
            return text
    except OSError as error:
        raise ArgumentTypeError(
            f"'{text}': nothing can be written in {folder} ({error.strerror}); choose another path"
        ) from None


def file_to_write(text: str) -> str:
    """Return the path of a file that can be written, whose folder is there or can be made.

    Raises:
        ArgumentTypeError: a folder is there, or nothing can be written at the place.
    """
    if text and Path(text).is_dir():
        raise ArgumentTypeError(f"'{text}' is a folder, expected the path of a file")
    return path_to_write(text)


def folder_to_write(text: str) -> str:
    """Return the path of a folder that can be written to, or be made.

    Raises:
        ArgumentTypeError: a file is there, or nothing can be written at the place.
    """
    if text and Path(text).exists() and not Path(text).is_dir():
        raise ArgumentTypeError(f"'{text}' is a file, expected the path of a folder")
    return path_to_write(text)
