"""Running systems for tests: processes of their own over real DDS."""

import pytest
import rclpy
from system_listener import Listener

from tactile_dynamics_ros.cli.bringup import write_parameters
from tactile_dynamics_ros.cli.live import DEFAULT_CONFIG
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command, verb_command
from tactile_dynamics_ros.share import share_file


@pytest.fixture
def listener():
    """A listening node; none of its topics is listed after the test, even if that failed."""
    listening = Listener()
    yield listening
    listening.node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def over_udp(monkeypatch):
    """Messages go by UDP alone, for tests that kill processes.

    One that dies while it holds the lock of a shared memory port leaves its readers deaf, those of
    the test too (Fast DDS issue 5469); seldom, but it happened.
    """
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


@pytest.fixture
def system(tmp_path):
    """A supervisor whose processes are stopped after the test, and ways to start nodes."""
    files = write_parameters(share_file(DEFAULT_CONFIG), tmp_path / "parameters")
    with Supervisor(tmp_path / "logs") as supervisor:

        def start_node(name, **parameters):
            given = {key.replace("__", "."): value for key, value in parameters.items()}
            command = node_command(name, files[name], given)
            return supervisor.start(name, command)

        supervisor.start_node = start_node
        supervisor.start_verb = lambda name, *words: supervisor.start(name, verb_command(*words))
        yield supervisor
        for member in supervisor.members.values():
            print(f"{member.name}, exits {member.exit_codes}:\n{member.last_words(15)}")
