"""What every importer provides: a name for the command, its arguments, and a recording."""

from __future__ import annotations

from abc import ABC, abstractmethod
from argparse import ArgumentParser, Namespace
from pathlib import Path

from tactile_dynamics_ros.recording.recording import Recording


class Importer(ABC):
    """Turns measurements in some other form into a recording.

    Attributes:
        name: word after ``tactile-dynamics import``.
        summary: one line for the help.
        source_help: what the source argument names.
    """

    name: str
    summary: str
    source_help: str

    def add_arguments(self, parser: ArgumentParser) -> None:  # noqa: B027
        """Add options beyond source and output; none by default."""

    @abstractmethod
    def read(self, source: Path, options: Namespace) -> Recording:
        """Read the source.

        Raises:
            BadInputError: the source is not what this importer reads.
        """
