"""Exported bodies, read back by who they are written for."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
import trimesh
import yaml
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation
from synthetic_recording import held_box

import tactile_dynamics_ros as td
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate, ModelError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.shape.object_shape import load_shape
from tactile_dynamics_ros.export import FORMATS, export


@pytest.fixture(scope="module")
def estimate():
    """A flat body, its products of inertia as large as they can be told from each other."""
    com = np.array([0.011, -0.007, 0.023])
    turn = np.linalg.qr(np.array([[2.0, 1.0, 0.3], [-1.0, 2.0, 0.7], [0.2, -0.4, 3.0]]))[0]
    inertia = turn @ np.diag([3e-4, 5e-4, 7.9e-4]) @ turn.T
    body = InertialParameters(0.731, com, inertia)
    error = ModelError(0.03, 1e-3, 1.02)
    return InertialEstimate(body, 1e-10 * np.eye(10), {}, error, (), 1000, 10.0, True)


def check(body, mass, com, inertia_com, relative=1e-8):
    assert mass == pytest.approx(body.mass, rel=1e-9)
    np.testing.assert_allclose(com, body.com, atol=1e-9)
    np.testing.assert_allclose(inertia_com, body.inertia_com, rtol=relative, atol=1e-13)


def matrix(values):
    """Return the matrix of named moments such as ixx."""
    found = np.zeros((3, 3))
    for name, value in values.items():
        i, j = ("xyz".index(axis) for axis in name[1:])
        found[i, j] = found[j, i] = float(value)
    return found


def numbers(text):
    return np.array(text.split(), dtype=float)


def test_a_urdf_is_read_back_by_the_urdf_parser(estimate):
    from urdf_parser_py.urdf import URDF

    (link,) = URDF.from_xml_string(export(estimate, "urdf").text).links
    inertial = link.inertial
    assert inertial.origin.rpy == [0, 0, 0]
    check(estimate.inertia, inertial.mass, inertial.origin.xyz, inertial.inertia.to_matrix())


def test_a_urdf_moves_in_bullet_as_the_body_does(estimate, tmp_path):
    bullet = pytest.importorskip("pybullet")
    path = tmp_path / "object.urdf"
    path.write_text(export(estimate, "urdf").text)
    client = bullet.connect(bullet.DIRECT)
    try:
        flags = bullet.URDF_USE_INERTIA_FROM_FILE
        body = bullet.loadURDF(str(path), flags=flags, physicsClientId=client)
        info = bullet.getDynamicsInfo(body, -1, physicsClientId=client)
    finally:
        bullet.disconnect(client)
    turn = np.array(bullet.getMatrixFromQuaternion(info[4])).reshape(3, 3)
    inertia = turn @ np.diag(info[2]) @ turn.T
    check(estimate.inertia, info[0], info[3], inertia)


def test_an_mjcf_is_read_back_by_mujoco(estimate):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(export(estimate, "mjcf").text)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[1])
    turn = turn.reshape(3, 3)
    inertia = turn @ np.diag(model.body_inertia[1]) @ turn.T
    check(estimate.inertia, model.body_mass[1], model.body_ipos[1], inertia, 1e-6)


def test_an_mjcf_has_the_moments_in_mujocos_order(estimate):
    inertial = ElementTree.fromstring(export(estimate, "mjcf").text).find(".//inertial")
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    six = dict(zip(names, numbers(inertial.attrib["fullinertia"]), strict=True))
    check(
        estimate.inertia,
        float(inertial.attrib["mass"]),
        numbers(inertial.attrib["pos"]),
        matrix(six),
    )


def test_an_sdf_has_the_pose_of_the_centre_and_the_inertia_about_it(estimate):
    inertial = ElementTree.fromstring(export(estimate, "sdf").text).find("model/link/inertial")
    pose = numbers(inertial.find("pose").text)
    six = {entry.tag: entry.text for entry in inertial.find("inertia")}
    assert list(pose[3:]) == [0, 0, 0]
    check(estimate.inertia, float(inertial.find("mass").text), pose[:3], matrix(six))


def test_the_payload_call_of_universal_robots_has_the_moments_first(estimate):
    text = export(estimate, "ur").text
    (arguments,) = re.findall(r"^set_target_payload\((.*)\)$", text, re.MULTILINE)
    mass, com, six = json.loads(f"[{arguments}]")
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    check(estimate.inertia, mass, com, matrix(dict(zip(names, six, strict=True))))
    assert "only if that frame is the robot's flange" in text


def test_the_request_of_franka_is_yaml_with_a_matrix(estimate):
    request = yaml.safe_load(export(estimate, "franka").text)
    inertia = np.reshape(request["load_inertia"], (3, 3))
    check(estimate.inertia, request["mass"], request["center_of_mass"], inertia)


def test_the_request_of_xarm_is_in_kilograms_and_millimetres(estimate):
    request = yaml.safe_load(export(estimate, "xarm").text)
    assert request["weight"] == pytest.approx(estimate.inertia.mass)
    np.testing.assert_allclose(request["center_of_gravity"], 1e3 * estimate.inertia.com)


def test_the_load_of_kuka_has_principal_axes(estimate):
    text = export(estimate, "kuka").text
    mass, *values = map(float, re.findall(r"[MXYZABC] (-?[\d.e-]+)[,}]", text.splitlines()[-1]))
    centre, (a, b, c), moments = values[:3], np.radians(values[3:6]), values[6:]
    turn = Rotation.from_euler("ZYX", [a, b, c]).as_matrix()
    inertia = turn @ np.diag(moments) @ turn.T
    check(estimate.inertia, mass, 1e-3 * np.array(centre), inertia)


def test_controllers_get_mass_or_weight_and_the_centre_in_metres(estimate):
    body = estimate.inertia
    found = yaml.safe_load(export(estimate, "control_toolbox").text)["tool"]
    weight = -found["mass"] * found["gravity_field"][2]
    np.testing.assert_allclose(found["pos"], body.com)
    centre = yaml.safe_load(export(estimate, "admittance_controller").text)
    found = centre["gravity_compensation"]["CoG"]
    assert found["force"] == pytest.approx(weight) == pytest.approx(9.81 * body.mass)
    np.testing.assert_allclose(found["pos"], body.com)


@pytest.mark.parametrize("form", FORMATS)
def test_what_a_recording_does_not_tell_is_not_written(estimate, form):
    flat = replace(estimate, not_excited=("inertia_xz", "inertia_zz"))
    if form in ("xarm", "control_toolbox", "admittance_controller"):
        assert "inertia, which this recording does not determine" in export(flat, form).left_out
    elif form == "ur":
        made = export(flat, form)
        assert made.text.splitlines()[-1].count("[") == 1
        assert "inertia, which this recording does not determine" in made.left_out
    else:
        with pytest.raises(
            NotIdentifiableError, match="inertia_xz, inertia_zz.*ur, xarm, .* take mass"
        ):
            export(flat, form)
    with pytest.raises(NotIdentifiableError, match="does not determine com_z"):
        export(replace(estimate, not_excited=("com_z",)), form)


MOVEIT = {
    "AttachedCollisionObject": "string link_name\nCollisionObject object\nstring[] touch_links\n"
    "sensor_msgs/JointState attach_posture\nfloat64 weight\n",
    "CollisionObject": "std_msgs/Header header\ngeometry_msgs/Pose pose\nstring id\n"
    "object_recognition_msgs/ObjectType type\nshape_msgs/SolidPrimitive[] primitives\n"
    "geometry_msgs/Pose[] primitive_poses\nshape_msgs/Mesh[] meshes\n"
    "geometry_msgs/Pose[] mesh_poses\nshape_msgs/Plane[] planes\n"
    "geometry_msgs/Pose[] plane_poses\nstring[] subframe_names\n"
    "geometry_msgs/Pose[] subframe_poses\nbyte operation\n",
}
"""Messages of MoveIt, as their package defines them."""


@pytest.fixture(scope="module")
def fields():
    """Fields of messages by their type: basic types, or types and whether they are lists."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(
        get_types_from_msg("string key\nstring db\n", "object_recognition_msgs/msg/ObjectType")
    )
    for name in reversed(MOVEIT):
        store.register(get_types_from_msg(MOVEIT[name], f"moveit_msgs/msg/{name}"))
    return {kind: dict(entry[1]) for kind, entry in store.fielddefs.items()}


def require_fits(value, kind, fields):
    """Check that a value read from yaml can be given to a message, as `ros2 topic pub` does."""
    assert value.keys() <= fields[kind].keys(), kind
    for key, part in value.items():
        node, what = fields[kind][key]
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (node, what), parts = what[0], part
            assert isinstance(parts, list), key
        else:
            parts = [part]
        for one in parts:
            if node == Nodetype.NAME:
                require_fits(one, what, fields)
            else:
                wanted = {"string": str, "float64": float}.get(what[0], int)
                assert isinstance(one, wanted), (key, one)


def attached(text, fields):
    """Read an attached object back; return it, its shapes and their poses (4, 4)."""
    found = yaml.safe_load(text)
    require_fits(found, "moveit_msgs/msg/AttachedCollisionObject", fields)
    poses = []
    for pose in found["object"].get("primitive_poses", ()):
        made = np.eye(4)
        turn = [pose["orientation"][axis] for axis in "xyzw"]
        made[:3, :3] = Rotation.from_quat(turn).as_matrix()
        made[:3, 3] = [pose["position"][axis] for axis in "xyz"]
        poses.append(made)
    return found, found["object"].get("primitives", []), poses


def test_moveit_gets_the_box_that_has_the_mass_and_the_inertia(estimate, fields):
    text = export(estimate, "moveit", name="box").text
    found, (box,), (pose,) = attached(text, fields)
    assert (found["object"]["id"], box["type"]) == ("box", 1)
    assert "the box with the same mass and inertia" in text
    squares = np.square(box["dimensions"])
    moments = found["weight"] / 12.0 * (squares.sum() - squares)
    turn = pose[:3, :3]
    inertia = turn @ np.diag(moments) @ turn.T
    check(estimate.inertia, found["weight"], pose[:3, 3], inertia, 1e-6)


def test_moveit_gets_the_shape_that_is_given(estimate, fields, tmp_path):
    file = tmp_path / "pan.yaml"
    file.write_text(
        "shapes:\n"
        "  - {box: [0.2, 0.03, 0.02], centre: [0.1, 0.0, 0.01]}\n"
        "  - {cylinder: {radius: 0.06, height: 0.05}}\n"
        "  - {sphere: {radius: 0.01}, centre: [0.2, 0.0, 0.0]}\n"
    )
    flat = replace(estimate, not_excited=("inertia_xx",))  # a shape needs none
    _, shapes, poses = attached(export(flat, "moveit", shape=load_shape(file)).text, fields)
    assert [s["type"] for s in shapes] == [1, 3, 2]
    assert shapes[1]["dimensions"] == [0.05, 0.06]  # height, then radius
    np.testing.assert_allclose(poses[0][:3, 3], [0.1, 0.0, 0.01])
    np.testing.assert_allclose(poses[2][:3, 3], [0.2, 0.0, 0.0])


def test_moveit_gets_a_mesh_corner_by_corner(estimate, fields, tmp_path):
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.export(tmp_path / "box.stl")
    shape = load_shape(tmp_path / "box.stl")
    found, _, _ = attached(export(estimate, "moveit", shape=shape).text, fields)
    (mesh,) = found["object"]["meshes"]
    corners = np.array([[corner[axis] for axis in "xyz"] for corner in mesh["vertices"]])
    faces = [triangle["vertex_indices"] for triangle in mesh["triangles"]]
    assert trimesh.Trimesh(corners, faces).volume == pytest.approx(box.volume, rel=1e-6)
    with pytest.raises(BadInputError, match="takes no shape"):
        export(estimate, "urdf", shape=shape)


def test_an_unknown_format_is_refused(estimate):
    with pytest.raises(BadInputError, match="expected one of urdf, sdf"):
        export(estimate, "obj")


def test_the_command_prints_the_block_alone_and_says_what_is_not_in_it(tmp_path, capsys):
    bag = held_box(seconds=4.0).to_bag(tmp_path / "box.mcap")
    assert main(["estimate", str(bag), "--export", "sdf"]) == 0
    out, err = capsys.readouterr()
    mass = float(ElementTree.fromstring(out).find(".//mass").text)
    assert mass == pytest.approx(td.estimate(td.read(bag)).found.inertia.mass)
    assert "left out: friction" in err
    assert main(["estimate", str(bag), "--export", "sdf", "--json"]) == 2
    assert capsys.readouterr().out == ""
