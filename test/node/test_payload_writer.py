"""Node: the payload reaches the arm's driver in its units, when asked for and never in doubt."""

from __future__ import annotations

import importlib
import sys

import numpy as np
import pytest
from built_interfaces import build, require_compilers

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
)
from tactile_dynamics_ros.nodes.payload_writer import PayloadWriterNode
from tactile_dynamics_ros.recording.yaml_files import write_body
from tactile_dynamics_ros.ros.handover import Handover, HandoverConfig
from tactile_dynamics_ros.ros.payload_services import DRIVERS
from tactile_dynamics_ros.ros.shell import Shell

BODY = InertialParameters(0.731, np.array([0.011, -0.007, 0.023]), np.diag([9e-4, 7e-4, 5e-4]))
DEFINITIONS = {
    "ur_msgs": (
        "srv/SetPayload.srv",
        "float32 mass\ngeometry_msgs/Vector3 center_of_gravity\n---\nbool success\n",
    ),
    "ur_msgs_rolling": (
        "srv/SetPayload.srv",
        "geometry_msgs/Inertia payload\nfloat64 transition_time\n---\nbool success\n",
    ),
    "franka_msgs": (
        "srv/SetLoad.srv",
        "float64 mass\nfloat64[3] center_of_mass\nfloat64[9] load_inertia\n---\n"
        "bool success\nstring error\n",
    ),
    "xarm_msgs": (
        "srv/SetTcpLoad.srv",
        "float32 weight\nfloat32[] center_of_gravity\n---\nint32 ret\nstring message\n",
    ),
}
"""Services of the drivers, as their packages define them; that of a UR in Jazzy and in Rolling."""
TOOLS = {
    "srv/ConfigCreateTool.srv": "string name\nfloat64 weight\nfloat64[3] cog\n"
    "float64[6] inertia\n---\nbool success\n",
    "srv/ConfigDeleteTool.srv": "string name\n---\nbool success\n",
    "srv/SetCurrentTool.srv": "string name\n---\nbool success\n",
}
"""Services of a Doosan's driver, dsr_msgs2."""


@pytest.fixture(scope="module", autouse=True)
def drivers(tmp_path_factory):
    """Build the services, which come with the drivers of arms."""
    require_compilers()
    out = tmp_path_factory.mktemp("interfaces")
    for package, (path, text) in DEFINITIONS.items():
        uses = ["geometry_msgs", "service_msgs", "builtin_interfaces"]
        build(package, {path: text}, uses, out)
    build("dsr_msgs2", TOOLS, ["service_msgs", "builtin_interfaces"], out)
    sys.path.insert(0, str(out))
    yield
    sys.path.remove(str(out))


class Arm(Shell):
    """Stands in for the driver of an arm: notes what it is given, and answers."""

    def __init__(self, driver, answer):
        super().__init__("arm")
        self.given = []

        def serve(request, response):
            self.given.append(request)
            fields = answer.get(type(request).__name__, answer)
            for key in fields.keys() & response.get_fields_and_field_types():
                setattr(response, key, fields[key])
            return response

        folder = driver.service.rpartition("/")[0]
        for one in (driver, *driver.before, *driver.after):
            package, _, name = one.kind.split("/")
            kind = getattr(importlib.import_module(f"{package}.srv"), name)
            self.create_service(kind, f"{folder}/{one.service.rpartition('/')[2]}", serve)


def file_of(tmp_path, std=1e-4, undetermined=()):
    covariance = np.diag([std**2, *[1e-10] * 3, *[1e-14] * 6])
    known = KnownBody(BODY.dynamic_parameters, covariance, "box", undetermined)
    return write_body(known, tmp_path / "box.yaml")


def start(bench, file, *arguments, controller="ur", answer=None, arm=True):
    words = ("-p", f"load:={file}", "-p", "maximum_mass:=5.0", "-p", f"controller:={controller}")
    node = bench.start(PayloadWriterNode, *words, *arguments)
    if arm:
        driver = DRIVERS[controller]
        bench.nodes.append(Arm(driver, answer or {"success": True}))
    return node


def apply(bench, node):
    """Call the service as a person does, while all nodes work."""
    from rclpy.executors import SingleThreadedExecutor
    from std_srvs.srv import Trigger

    executor = SingleThreadedExecutor()
    for one in bench.nodes:
        executor.add_node(one)
    client = node.create_client(Trigger, "/payload/apply")
    assert client.wait_for_service(5.0)
    if len(bench.nodes) > 1:
        clients = node.handover.clients
        bench.until(lambda: all(client.service_is_ready() for client in clients))
    future = client.call_async(Trigger.Request())

    def answered():
        executor.spin_once(timeout_sec=0.01)
        return future.done()

    bench.until(answered)
    return future.result()


def test_a_ur_gets_kilograms_and_metres(bench, tmp_path):
    node = start(bench, file_of(tmp_path))
    answer = apply(bench, node)
    assert answer.success, answer.message
    (given,) = bench.nodes[1].given
    assert given.mass == pytest.approx(BODY.mass)
    com = given.center_of_gravity
    np.testing.assert_allclose([com.x, com.y, com.z], BODY.com)


@pytest.mark.parametrize("known", [True, False])
def test_a_later_driver_of_a_ur_gets_the_inertia_where_it_is_known(known):
    kind = importlib.import_module("ur_msgs_rolling.srv").SetPayload
    given = kind.Request()
    DRIVERS["ur"].fill(given, BODY, known, 1.0)
    payload = given.payload
    assert payload.m == pytest.approx(BODY.mass)
    np.testing.assert_allclose([payload.com.x, payload.com.y, payload.com.z], BODY.com)
    moments = np.diag(BODY.inertia_com) if known else np.zeros(3)
    np.testing.assert_allclose([payload.ixx, payload.iyy, payload.izz], moments)
    assert given.transition_time == 1.0


def test_the_frame_of_the_pose_is_placed_in_the_flange(bench, tmp_path):
    words = (
        "-p",
        "flange_xyz:=[0.0, 0.0, 0.1]",
        "-p",
        "flange_rpy:=[0.0, 0.0, 1.5707963267948966]",
    )
    node = start(bench, file_of(tmp_path), *words)
    assert apply(bench, node).success
    (given,) = bench.nodes[1].given
    com = given.center_of_gravity
    np.testing.assert_allclose([com.x, com.y, com.z], [0.007, 0.011, 0.123], atol=1e-9)
    body, _ = node.handover.payload(node._carried.load.body)
    assert body.inertia_com[0, 0] == pytest.approx(BODY.inertia_com[1, 1])


def test_franka_gets_a_matrix_and_xarm_millimetres(bench, tmp_path):
    answer = {"success": True, "error": ""}
    node = start(bench, file_of(tmp_path), controller="franka", answer=answer)
    assert apply(bench, node).success
    (given,) = bench.nodes[1].given
    np.testing.assert_allclose(np.reshape(given.load_inertia, (3, 3)), BODY.inertia_com, atol=1e-12)


def test_xarm_gets_millimetres_and_its_refusal_is_said(bench, tmp_path):
    answer = {"ret": 9, "message": "not ready"}
    node = start(bench, file_of(tmp_path), controller="xarm", answer=answer)
    said = apply(bench, node)
    (given,) = bench.nodes[1].given
    np.testing.assert_allclose(given.center_of_gravity, 1e3 * BODY.com, rtol=1e-5)
    assert not said.success and said.message == "refused by the driver: not ready"


KEPT = "tactile_dynamics_payload"


def test_a_doosan_gets_a_tool_in_millimetres_and_uses_it(bench, tmp_path):
    """One of that name may not exist yet: whether it could be deleted does not count."""
    answer = {"ConfigDeleteTool_Request": {"success": False}, "success": True}
    node = start(bench, file_of(tmp_path), controller="doosan", answer=answer)
    said = apply(bench, node)
    assert said.success, said.message
    deleted, created, used = bench.nodes[1].given
    assert [type(one).__name__ for one in (deleted, created, used)] == [
        f"{name}_Request" for name in ("ConfigDeleteTool", "ConfigCreateTool", "SetCurrentTool")
    ]
    assert {deleted.name, created.name, used.name} == {KEPT}
    assert created.weight == pytest.approx(BODY.mass)
    np.testing.assert_allclose(created.cog, 1e3 * BODY.com)
    assert not np.any(created.inertia)


@pytest.mark.parametrize(("refused", "asked"), [("ConfigCreateTool", 2), ("SetCurrentTool", 3)])
def test_a_doosan_that_refuses_a_step_is_asked_no_further(bench, tmp_path, refused, asked):
    answer = {f"{refused}_Request": {"success": False}, "success": True}
    node = start(bench, file_of(tmp_path), controller="doosan", answer=answer)
    said = apply(bench, node)
    assert not said.success and "manual mode" in said.message
    assert len(bench.nodes[1].given) == asked


@pytest.mark.parametrize(
    ("file", "arguments", "reason"),
    [
        ({}, ("-p", "maximum_mass:=0.5"), "0.731 kg is more than maximum_mass = 0.5 kg"),
        ({"std": 0.1}, (), "is wider than mass_share"),
        ({"undetermined": ("com_z",)}, (), "com_z is undetermined"),
    ],
)
def test_what_is_in_doubt_or_too_heavy_is_not_handed_over(bench, tmp_path, file, arguments, reason):
    node = start(bench, file_of(tmp_path, **file), *arguments)
    said = apply(bench, node)
    assert not said.success and reason in said.message
    assert bench.nodes[1].given == []


def test_without_inertia_a_franka_gets_nothing_and_a_ur_the_rest(bench, tmp_path):
    file = file_of(tmp_path, undetermined=("inertia_xx",))
    node = start(bench, file)
    assert apply(bench, node).message.endswith("without inertia")
    assert bench.nodes[1].given[0].mass == pytest.approx(BODY.mass)
    franka = Handover(node, HandoverConfig(controller="franka", maximum_mass=5.0))
    with pytest.raises(NotIdentifiableError, match="its inertia is not known"):
        franka.payload(node._carried.load.body)


def test_a_driver_that_is_not_there_is_said_at_once(bench, tmp_path):
    node = start(bench, file_of(tmp_path), arm=False)
    said = apply(bench, node)
    assert not said.success and "is the driver running?" in said.message
