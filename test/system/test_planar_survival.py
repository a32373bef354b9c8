"""SIGKILL of any node of the table: it works again after its restart, and keeps what it knew."""

import os
import signal
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PolygonStamped, PoseStamped, PoseWithCovarianceStamped
from std_srvs.srv import Trigger

from tactile_dynamics_ros.cli.bringup import write_parameters
from tactile_dynamics_ros.cli.demo_planar import CONFIG, looking_command
from tactile_dynamics_ros.cli.push_goal import _pose
from tactile_dynamics_ros.cli.supervisor import node_command
from tactile_dynamics_ros.core.planar.known import KnownPushed
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.recording.pushed.known_files import write_known
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.share import share_file

AWAY = (0.62, 0.2, 90.0)
"""m, m, deg: a goal that takes longer than the test."""
AGAIN = 2.0
"""Real seconds after which a call that says nothing is made again."""
RESTART = 60.0
"""Real seconds until a node works again; 10 on an idle machine, of which it imports for four."""
STATUS, SHAPE = "/property_estimator/status", "/object/footprint"
CAMERA = "/camera/target"
PROGRESS = {"explorer": "/explorer/progress", "push_controller": "/push_controller/progress"}


@pytest.fixture
def story(over_udp, system, listener, tmp_path):
    """A table with all planar nodes; the estimator keeps what it knows in a file.

    The images are such as UDP brings at the usual size of a socket's buffer.
    """
    memory = tmp_path / "object.yaml"
    friction, spread = np.log(1.7), np.diag(np.square([0.05, 0.2, 1e-3, 1e-3]))
    known = KnownPushed(np.array([friction, 0.1, 0.0, 0.0]), spread, "before")
    write_known(known, memory)
    clock = {"use_sim_time": True}
    scene = {"scene": "table", "object_number": 121, "vision_rate_hz": 30.0, "depth_rate_hz": 5.0}
    scene |= {"camera.width": 160, "camera.height": 120}
    nodes = {
        "robot_sim": scene,
        "property_estimator": clock | {"prior": str(memory), "save": str(memory)},
        "explorer": clock,
        "push_controller": clock,
        "model_check": clock | {"model": "pushed", "period": 600.0},
    }
    system.start_verb("recorder", "record", str(tmp_path / "recording"))
    for name, parameters in nodes.items():
        system.start(name, node_command(name, None, parameters))
    files = write_parameters(share_file(CONFIG), tmp_path / "parameters")
    system.start("shape_estimator", looking_command(files["shape_estimator"]))
    listener.follow(PoseStamped, "/pusher/pose")
    listener.follow(PoseStamped, CAMERA)
    listener.follow(PoseWithCovarianceStamped, "/object/pose")
    listener.follow(DiagnosticArray, STATUS, latched=True)
    listener.follow(PolygonStamped, SHAPE, latched=True)
    for topic in PROGRESS.values():
        listener.follow(DiagnosticStatus, topic, latched=True)
    listener.wait_for_new("/pusher/pose", 120.0, 20)
    return system


def kill(system, listener, name):
    """Kill a node and wait until it was started again; return when that was."""

    def restarted():
        system.watch()
        return system.members[name].restarts > 0

    os.kill(system.members[name].process.pid, signal.SIGKILL)
    system.members[name].process.wait(timeout=10)
    listener.wait(restarted, 30.0, f"{name} is started again")
    return time.monotonic()


def known(listener):
    """Friction force, N, and its standard deviation; infinite while no estimate is published."""
    found = {s.name: status_values(s) for s in listener.seen[STATUS][-1].status}
    link = found.get("link_1", {})
    return tuple(float(link.get(f"friction_force_n{end}", np.inf)) for end in ("", "_std"))


def call(listener, service):
    """Call a service as soon as it is offered; return the future of its answer."""
    client = listener.node.create_client(Trigger, service)
    listener.wait(client.service_is_ready, RESTART, service)
    return client.call_async(Trigger.Request())


def send_goal(listener):
    """Publish a goal until push_controller says that it pushes."""
    heard = listener.seen[PROGRESS["push_controller"]]
    publisher = listener.node.create_publisher(PoseStamped, "/goal_pose", 10)
    heard.clear()

    def pushing():
        publisher.publish(_pose(AWAY))
        return any(status_values(status)["state"] == "pushing" for status in heard)

    listener.wait(pushing, RESTART, "push_controller pushes")


def explore(listener):
    """Call explorer/explore until it says what it does.

    The first call may go to the node that was killed, which is still listed, and the new one
    refuses before it has seen the object.
    """
    heard, client = (
        listener.seen[PROGRESS["explorer"]],
        listener.node.create_client(Trigger, "/explorer/explore"),
    )
    heard.clear()
    asked = [-np.inf]

    def busy():
        if time.monotonic() - asked[-1] > AGAIN and client.service_is_ready():
            asked.append(time.monotonic())
            client.call_async(Trigger.Request())
        return any(status_values(status)["state"] in ("choosing", "pushing") for status in heard)

    listener.wait(busy, RESTART, "explorer chooses")


def look(listener):
    """Call shape_estimator/start until the camera is sent on, or the shape is known."""
    heard, client = (
        listener.seen[CAMERA],
        listener.node.create_client(Trigger, "/shape_estimator/start"),
    )
    heard.clear()
    asked = []

    def looking():
        late = not asked or time.monotonic() - asked[-1][0] > AGAIN
        if late and client.service_is_ready():
            asked.append((time.monotonic(), client.call_async(Trigger.Request())))
        return heard or any(answer.done() and answer.result().success for _, answer in asked)

    listener.wait(looking, RESTART, "shape_estimator looks")


def diagnosed(listener):
    """Call model_check/diagnose until it answers."""
    client = listener.node.create_client(Trigger, "/model_check/diagnose")
    asked = []

    def answered():
        late = not asked or time.monotonic() - asked[-1][0] > AGAIN
        if late and client.service_is_ready():
            asked.append((time.monotonic(), client.call_async(Trigger.Request())))
        return any(answer.done() for _, answer in asked)

    listener.wait(answered, RESTART, "model_check answers")


@pytest.mark.timeout(400)
def test_any_node_of_the_table_may_be_killed(story, listener, tmp_path):
    listener.wait(lambda: listener.seen[STATUS], RESTART, "a status")
    listener.wait(lambda: known(listener)[1] < 0.3, RESTART, "what the file says")
    took = {}

    look(listener)
    began = kill(story, listener, "shape_estimator")
    look(listener)
    took["shape_estimator"] = time.monotonic() - began
    story.stop(["shape_estimator"])

    began = kill(story, listener, "property_estimator")
    listener.wait_for_new(STATUS, RESTART)
    listener.wait(lambda: known(listener)[1] < 0.3, RESTART, "the estimate is kept")
    took["property_estimator"] = time.monotonic() - began
    assert known(listener)[0] == pytest.approx(1.7, abs=0.1)

    send_goal(listener)
    began = kill(story, listener, "push_controller")
    place = listener.wait_for_new("/pusher/pose", 30.0, 30).pose.position
    later = listener.wait_for_new("/pusher/pose", 30.0, 30).pose.position
    assert np.hypot(later.x - place.x, later.y - place.y) < 0.02  # nobody moves the tip
    send_goal(listener)
    took["push_controller"] = time.monotonic() - began
    call(listener, "/push_controller/stop")

    began = kill(story, listener, "explorer")
    explore(listener)
    took["explorer"] = time.monotonic() - began

    began = kill(story, listener, "model_check")
    diagnosed(listener)
    took["model_check"] = time.monotonic() - began
    print("works again after", {name: round(seconds, 1) for name, seconds in took.items()}, "s")
    assert max(took.values()) < RESTART

    story.stop(["recorder"])
    streams = PushedRecording.from_bag(tmp_path / "recording").streams
    assert len(streams.links[0].time) > 100
