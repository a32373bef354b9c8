"""Node: an arm weighs what it carries, shows its motion, and stands when something is wrong."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.weighing.arm import SerialArm
from tactile_dynamics_ros.core.weighing.excitation import WeighingConfig, plan_weighing
from tactile_dynamics_ros.nodes.robot_sim import RobotSim
from tactile_dynamics_ros.nodes.weigher import WeigherNode
from tactile_dynamics_ros.ros import names
from tactile_dynamics_ros.ros.shell import LATCHED, Shell

pytest.importorskip("pybullet")
SHORT = ("-p", "motion.duration:=5.0", "-p", "motion.evaluations:=30", "-p", "seed:=8")


class Cell:
    """A simulated arm, the weigher, and a person who calls services."""

    def __init__(self, bench, tmp_path, *arguments):
        words = ("-p", "scene:=arm", "-p", f"folder:={tmp_path}/weighed", *SHORT, *arguments)
        self.bench = bench
        self.sim = bench.start(RobotSim, *words)
        self.weigher = bench.start(WeigherNode)
        self.person = bench.start(lambda: Shell("person"))
        self.executor = SingleThreadedExecutor()
        for node in bench.nodes:
            self.executor.add_node(node)

    @property
    def phase(self):
        return self.weigher._state[0]

    def until(self, condition, timeout=40.0):
        def met():
            self.executor.spin_once(timeout_sec=0.0)
            return condition()

        self.bench.until(met, timeout)

    def ask(self, service):
        """Call a service and return the future of its answer."""
        client = self.person.create_client(Trigger, f"/{service}")
        self.until(client.service_is_ready)
        return client.call_async(Trigger.Request())

    def answer(self, future):
        self.until(future.done)
        return future.result()

    def at_rest(self):
        """Whether no joint moves faster than a servo's tremor, rad/s."""
        return np.abs(self.sim.scene.arm._state()[1]).max() < 0.02


@pytest.fixture
def cell(bench, tmp_path, request):
    return Cell(bench, tmp_path, *getattr(request, "param", ()))


def test_a_plan_is_shown_and_nothing_moves(cell):
    from trajectory_msgs.msg import JointTrajectory
    from visualization_msgs.msg import MarkerArray

    shown, drawn = [], []
    cell.person.listen(JointTrajectory, names.WEIGH_MOTION, shown.append, LATCHED)
    cell.person.listen(MarkerArray, names.WEIGH_MARKERS, drawn.append, LATCHED)
    before = np.array(cell.sim.scene.arm._state()[0])
    plan = json.loads(cell.answer(cell.ask(names.WEIGH_PLAN)).message)
    cell.until(lambda: shown and drawn)
    assert plan["duration_s"] == 5.0 and max(plan["largest_turn_rad"]) > 0.1
    assert len(shown[0].joint_names) == 7 and len(drawn[0].markers[0].points) > 20
    assert cell.sim.scene.arm._trajectory is None
    np.testing.assert_allclose(cell.sim.scene.arm._state()[0], before, atol=0.01)


def test_the_emergency_stop_brings_the_arm_to_rest(cell):
    answer = cell.ask(names.WEIGH)
    cell.until(lambda: cell.weigher.arm_motion.share > 0.3)
    assert not cell.at_rest()
    stop = cell.person.create_publisher(Bool, names.EMERGENCY_STOP, LATCHED)
    stop.publish(Bool(data=True))
    said = cell.answer(answer)
    assert not said.success and "emergency stop" in said.message
    cell.until(cell.at_rest)
    again = cell.answer(cell.ask(names.WEIGH))
    assert not again.success and "publish false" in again.message


def test_a_motion_that_is_stopped_before_any_joint_is_heard_of_does_not_begin(cell):
    """The controller has it already: an arm that is told nothing would go on."""
    cell.until(lambda: len(cell.weigher.arm_motion._positions) == 7)
    follow, followed = cell.sim.scene.arm.follow, []
    cell.sim.scene.arm.follow = lambda *way: (followed.append(way), follow(*way))
    arm = SerialArm.of_urdf(cell.sim.scene.arm.urdf, "", "wrist_sensor")
    start = cell.weigher.arm_motion.position_of(arm.names)
    motion = plan_weighing(arm, start, WeighingConfig(duration=5.0, evaluations=8))
    cell.weigher.arm_motion.begin(motion)
    cell.weigher.halt("at once")
    cell.until(lambda: len(followed) == 2)
    assert cell.weigher.arm_motion.taken.positions == []
    np.testing.assert_allclose(followed[1][2], [start])
    cell.until(cell.at_rest)


@pytest.mark.parametrize("cell", [("-p", "max_force:=3.0")], indirect=True)
def test_a_wrench_beyond_the_limit_stops_the_arm(cell):
    """The tool weighs 4 to 9 N."""
    said = cell.answer(cell.ask(names.WEIGH))
    assert not said.success and "more than max_force = 3 N" in said.message
    cell.until(cell.at_rest)


def test_an_arm_that_does_not_follow_is_stopped(cell):
    cell.sim.scene.arm.follow = lambda *_: None  # as a controller that is not active
    said = cell.answer(cell.ask(names.WEIGH))
    assert not said.success and "does not follow" in said.message


def test_silence_of_the_driver_stops_the_arm(cell):
    answer = cell.ask(names.WEIGH)
    cell.until(lambda: cell.weigher.arm_motion.share > 0.2)
    cell.bench.nodes.remove(cell.sim)  # it was killed
    said = cell.answer(answer)
    assert not said.success and "nothing came on" in said.message
    cell.bench.nodes.append(cell.sim)


def test_deactivating_the_node_stops_the_arm(cell):
    answer = cell.ask(names.WEIGH)
    cell.until(lambda: cell.weigher.arm_motion.share > 0.3)
    cell.weigher.trigger_deactivate()
    assert not cell.answer(answer).success
    cell.until(cell.at_rest)


def test_what_nobody_publishes_is_named(bench, tmp_path):
    alone = Cell.__new__(Cell)
    alone.bench = bench
    alone.weigher = bench.start(WeigherNode, "-p", f"folder:={tmp_path}")
    alone.person = bench.start(lambda: Shell("person"))
    alone.executor = SingleThreadedExecutor()
    for node in bench.nodes:
        alone.executor.add_node(node)
    said = alone.answer(alone.ask(names.WEIGH))
    assert not said.success and said.message == (
        "nothing comes on joint_states; is the driver running?"
    )


def test_tool_and_load_are_weighed_and_handed_over(bench, tmp_path):
    pytest.importorskip("tactile_dynamics_msgs")
    given = ("-p", "controller:=other", "-p", "maximum_mass:=6.0", "-p", "apply:=true")
    cell = Cell(bench, tmp_path, *given)
    answer = cell.ask(names.WEIGH)
    cell.until(lambda: cell.phase == "attach")
    assert cell.answer(cell.ask(names.ATTACH)).success
    assert cell.answer(cell.ask(names.WEIGH_PROCEED)).success
    cell.until(answer.done, 120.0)
    said = answer.result()
    assert said.success, said.message
    found, arm = json.loads(said.message), cell.sim.scene.arm
    for name in ("tool", "load"):
        body, truth = found[name], getattr(arm, name)
        assert abs(body["mass"]["value"] - truth.mass) < 5.0 * body["mass"]["std"]
        std = np.array(body["com"]["std"])
        assert np.all(np.abs(body["com"]["value"] - truth.com) < 5.0 * std)
    assert found["handed_over"] and found["doubts"] == []
    cell.until(lambda: arm.sag() < 2e-4)
    assert sorted(path.name for path in next((tmp_path / "weighed").iterdir()).iterdir()) == [
        "load.yaml", "load_1.mcap", "payload.yaml", "tool.yaml", "tool_1.mcap",
    ]  # fmt: skip
