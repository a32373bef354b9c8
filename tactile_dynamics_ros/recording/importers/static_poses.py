"""A table of static poses: one row per orientation with the wrench that a sensor reads there."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.importers.csv_mapping import read_mapping
from tactile_dynamics_ros.recording.importers.guess import Answers, guess_tables
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.recording import Recording


class StaticPosesImporter(Importer):
    """Columns and units are guessed as `import FILE --guess` does; rows need no time."""

    name = "static-poses"
    summary = "a table of static poses without time: orientation and wrench per row, 3 or more"
    source_help = "the table; `import TABLE --guess` shows how it is read and writes that as yaml"

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Add what may be known of the sensor."""
        parser.add_argument(
            "--reads",
            choices=("load", "object"),
            help="whether forces are those of the load on the sensor, or those on the object "
            "(found by default)",
        )

    def read(self, source: Path, options: Namespace) -> Recording:
        """Guess the mapping of a table and read it.

        Raises:
            BadInputError: something has to be asked.
        """
        reads = getattr(options, "reads", None)
        answers = Answers({"time": "none"} | ({"reads": reads} if reads else {}))
        guess = guess_tables([source], answers)
        if guess.question:
            raise BadInputError(f"{source}: {guess.question}")
        return read_mapping(guess.mapping, source.parent, str(source))
