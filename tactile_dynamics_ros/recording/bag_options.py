"""Options of commands that read the bag of a robot."""

from __future__ import annotations

from argparse import ArgumentParser


def add_bag_arguments(parser: ArgumentParser) -> None:
    """Add what may be known of the bag."""
    parser.add_argument(
        "--urdf",
        metavar="FILE",
        help="of the arm whose joint angles were recorded (default: /robot_description in the bag)",
    )
    parser.add_argument(
        "--stamps",
        choices=("header", "receive"),
        help="take messages at their stamps (default) or at the times at which they were received",
    )


def add_say(parser: ArgumentParser) -> None:
    """Add answers to questions."""
    parser.add_argument(
        "--say",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="answer a question; repeatable",
    )
