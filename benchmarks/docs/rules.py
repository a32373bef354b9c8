"""How a documented command is run: to its end, until it serves, later, or not at all."""

from __future__ import annotations

import re
import shlex

NOT_HERE: tuple[tuple[str, str], ...] = (
    (
        r"(ros2|rosdep|colcon|rviz2|plotjuggler|pip|sudo) |cd ~/ws|share=|(export )?ROS_SECURITY_",
        "ROS 2 from apt (README's block is typed by test/system/test_install.py)",
    ),
    (r".* --scheduler tcp:", "a cluster of dask workers"),
    (r".* --(carried|wrist) ", "a hand's /wrist/wrench and /joint_states (./dev bench wrist)"),
    (r"tactile-dynamics calibrate ", "pressed or warming fingertips (benchmarks.biotac_press_rig)"),
)
"""Beginnings of commands that cannot run on every machine, and what they need."""
LONG = re.compile(
    r"\./dev (demo|test|bench|docs|lint)|python -m |bash \.ci|tactile-dynamics (demo|train) "
)
"""Commands that take minutes or hours: demos, studies, trainings, the suite."""
OF_THE_SOURCE = re.compile(r"\./dev|python -m benchmarks|bash \.ci")
"""Commands that are typed in the source tree."""
ENDLESS = ("up", "sim", "view", "run", "record", "echo")
"""Verbs that last until Ctrl-C, unless a number of messages or seconds is given."""
OF_NODES = ("call", "set", "probe", "push", "explore", "echo")
"""Verbs that need running nodes."""
_BOUNDED = ("--count", "--duration")


def words(command: str) -> list[str]:
    """Return the words of a command."""
    return shlex.split(command)


def verb(command: str) -> str:
    """Return the verb of a `tactile-dynamics` command; empty for others."""
    given = words(command)
    return given[1] if given[0] == "tactile-dynamics" and len(given) > 1 else ""


def need(command: str) -> str:
    """Return what a command needs that this machine may lack; empty if nothing."""
    return next((reason for start, reason in NOT_HERE if re.match(start, command)), "")


def is_long(command: str) -> bool:
    """Whether a command takes minutes or hours."""
    return LONG.match(f"{command} ") is not None


def is_endless(command: str) -> bool:
    """Whether a command lasts until Ctrl-C."""
    return verb(command) in ENDLESS and not set(_BOUNDED) & set(words(command))


def needs_nodes(command: str) -> bool:
    """Whether a command talks to running nodes."""
    return verb(command) in OF_NODES


def starts_nodes(command: str) -> bool:
    """Whether a command starts nodes that later ones talk to: a simulated robot."""
    return verb(command) == "sim" or (verb(command) == "up" and "--simulate" in words(command))


def is_of_a_robot(command: str) -> bool:
    """Whether a command starts nodes that wait for a robot's topics."""
    return command.startswith(("ros2 launch", "ros2 run")) or (
        verb(command) == "up" and not starts_nodes(command)
    )
