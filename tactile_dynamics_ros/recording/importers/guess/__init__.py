"""What the columns of somebody else's table mean: proposed, tested on the weight, or asked."""

from tactile_dynamics_ros.recording.importers.guess.answers import Answers
from tactile_dynamics_ros.recording.importers.guess.fingers import Guess, guess_tables

__all__ = ["Answers", "Guess", "guess_tables"]
