"""DDS on this host only, and a domain of its own per run, so that parallel runs never meet."""

from __future__ import annotations

import fcntl
import os
import random
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.files import own_folder

DOMAINS = range(1, 100)
"""Domains whose ports lie below the ephemeral range of Linux; 0 is everybody's default."""

SHARED_MEMORY = Path("/dev/shm")
"""Where Fast DDS keeps the ports on which participants of one host hear each other."""
_FIRST_PORT, _PORTS = 7400, 250
"""Ports of a domain are 7400 + 250 domain and the following (DDSI-RTPS 2.2, 9.6.1.1)."""


def stay_on_this_host() -> None:
    """Keep DDS on this host unless a sourced ROS installation or the user says otherwise."""
    if "ROS_DISTRO" not in os.environ:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


@contextmanager
def private_domain() -> Iterator[int]:
    """Claim a ROS domain that no other run on this host holds, for this process and its children.

    The claim is a lock on a file and ends with the process, however it ends.

    Raises:
        BadInputError: there is no folder of this user alone for the locks.
        TactileDynamicsError: all domains are taken.
    """
    folder = own_folder()
    candidates = list(DOMAINS)
    random.Random(os.getpid()).shuffle(candidates)
    for domain in candidates:
        try:
            claim = os.open(folder / f"domain_{domain}", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW)
        except OSError:  # such as a link, which is not ours
            continue
        with os.fdopen(claim, "r+") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            remove_dead_ports(domain)
            os.environ["ROS_DOMAIN_ID"] = str(domain)
            os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
            yield domain
            return
    raise TactileDynamicsError(f"all {len(DOMAINS)} ROS domains of this host are taken ({folder})")


def remove_dead_ports(domain: int) -> None:
    """Remove ports of a domain in shared memory that nobody listens on.

    A process that was killed may have left one locked, and whoever writes to it would wait for
    ever. Who listens holds a lock on the port's file `_el`.
    """
    first = _FIRST_PORT + _PORTS * domain
    for port in range(first, first + _PORTS):
        name = f"fastrtps_port{port}"
        files = [SHARED_MEMORY / each for each in (f"{name}_el", name, f"sem.{name}_mutex")]
        with suppress(OSError), ExitStack() as held:  # it is listened on, or somebody else's
            if files[0].exists():
                lock = held.enter_context(files[0].open("r+"))
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for file in files:
                file.unlink(missing_ok=True)
