"""A recording of a robot in whatever messages its drivers publish."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.bag_options import add_bag_arguments, add_say
from tactile_dynamics_ros.recording.importers.csv_mapping import read_mapping
from tactile_dynamics_ros.recording.importers.guess import Answers, guess_tables
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.recording import Recording

_REMARKS = ("weight", "sensor", "world")
"""Labels of what was understood that is said even if nobody asked: it may be otherwise."""


def bag_answers(options: Namespace) -> dict[str, str]:
    """Return what options say as answers, by key.

    Raises:
        BadInputError: one is malformed.
    """
    found = {}
    for word in options.say:
        key, separator, value = word.partition("=")
        if not separator or not value:
            raise BadInputError(f"--say {word}: expected KEY=VALUE")
        found[key.strip()] = value.strip()
    if options.urdf:
        found["urdf"] = str(Path(options.urdf).resolve())
    if options.stamps:
        found["stamps"] = options.stamps
    return found


def read_robot_bag(path: Path, stamps: str | None = None, urdf: str | None = None) -> Recording:
    """Read the bag of a robot as `import bag` does.

    Args:
        path: of the bag.
        stamps: "receive" for the times at which messages were received.
        urdf: of the arm whose joint angles were recorded.

    Raises:
        BadInputError: something has to be asked.
    """
    try:
        return BagImporter().read(path, Namespace(say=[], stamps=stamps, urdf=urdf))
    except BadInputError as error:
        raise BadInputError(
            f"{error} (none of the topics of a recording is in it; questions are answered in "
            f"`tactile-dynamics import bag {path} OUT.mcap`)"
        ) from error


class BagImporter(Importer):
    """Topics, frames and signs are found as `import BAG --guess` finds them."""

    name = "bag"
    summary = "a bag of a robot: wrench and pose (or joint angles and a URDF) in any messages"
    source_help = "the bag; `import BAG --guess` shows how it is read and writes that as yaml"

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Add what may be known of the robot."""
        add_bag_arguments(parser)
        add_say(parser)

    def read(self, source: Path, options: Namespace) -> Recording:
        """Guess the mapping of a recording and read it.

        Raises:
            BadInputError: something has to be asked.
        """
        guess = guess_tables([source], Answers(bag_answers(options)))
        if guess.question:
            raise BadInputError(f"{source}: {guess.question}")
        recording = read_mapping(guess.mapping, source.parent, str(source))
        said = {f"{label}: {text}": 1 for label, text in guess.understood if label in _REMARKS}
        return replace(recording, problems=said | recording.problems)
