"""The command line of a node: what ROS takes, and nothing else."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from tactile_dynamics_ros.core.errors import BadInputError, nearest_file
from tactile_dynamics_ros.ros.names import enclave_of


def start_tool() -> None:
    """Initialise rclpy for a command of a person, who leaves it by the command's own handlers."""
    words = ["--ros-args", *enclave_of("operator")]
    rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)


def start_ros(arguments: Sequence[str] | None) -> None:
    """Initialise rclpy with the command line of a node.

    Args:
        arguments: the command line without the program; that of this process if None.

    Raises:
        BadInputError: ROS would ignore a part of it, or cannot read it.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    for flag, file in itertools.pairwise(words):
        if flag == "--params-file" and not Path(file).is_file():
            raise BadInputError(f"--params-file {file}: no such file{nearest_file(file)}")
    try:
        left = remove_ros_args(words)
        if left:
            raise BadInputError(
                f"'{left[0]}' is unknown; a node takes --ros-args with -p NAME:=VALUE "
                "(parameters), -r OLD:=NEW (names) and --params-file FILE"
            )
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # of rclpy, for arguments that it cannot read
        raise BadInputError(f"{' '.join(words)}: not understood by ROS: {error}") from error
