"""An estimate as text for simulators and robots, without what a recording does not determine."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.export.moveit import attached_object

Writer = Callable[[InertialParameters, str, list[str], bool], str]
"""(body, name, remarks, whether the inertia is known) -> text."""

STANDARD_GRAVITY = 9.81
"""m/s^2 by which a mass is written as a weight: that of the estimates, so that it cancels."""
_DIGITS = 12
"""Significant digits of a number: a body that can exist stays one, and a body read back differs
by 1e-12 of its size. With six, flat bodies whose largest moment is the sum of the others may break
the triangle inequality that MuJoCo checks."""


def urdf(body: InertialParameters, name: str, remarks: list[str], known: bool) -> str:
    """Return a robot of one link; its inertia is about the centre of mass, in the link's axes."""
    return "\n".join(
        [
            f'<robot name="{name}">',
            *_comment(remarks),
            f'  <link name="{name}">',
            "    <inertial>",
            f'      <origin xyz="{_spaced(body.com)}" rpy="0 0 0"/>',
            f'      <mass value="{_number(body.mass)}"/>',
            f"      <inertia {' '.join(_attributes(body))}/>",
            "    </inertial>",
            "  </link>",
            "</robot>",
        ]
    )


def sdf(body: InertialParameters, name: str, remarks: list[str], known: bool) -> str:
    """Return a model of one link; its inertia is about the centre of mass, in the link's axes."""
    inertia = "".join(f"<{key}>{_number(value)}</{key}>" for key, value in _six(body))
    return "\n".join(
        [
            '<sdf version="1.9">',
            *_comment(remarks),
            f'  <model name="{name}">',
            f'    <link name="{name}">',
            "      <inertial>",
            f"        <pose>{_spaced(body.com)} 0 0 0</pose>",
            f"        <mass>{_number(body.mass)}</mass>",
            f"        <inertia>{inertia}</inertia>",
            "      </inertial>",
            "    </link>",
            "  </model>",
            "</sdf>",
        ]
    )


def mjcf(body: InertialParameters, name: str, remarks: list[str], known: bool) -> str:
    """Return a free body; MuJoCo's `fullinertia` is xx yy zz xy xz yz about the centre of mass."""
    inertia = _spaced(value for _, value in _diagonal_first(body))
    return "\n".join(
        [
            f'<mujoco model="{name}">',
            *_comment(remarks),
            "  <worldbody>",
            f'    <body name="{name}">',
            "      <freejoint/>",
            f'      <inertial pos="{_spaced(body.com)}" mass="{_number(body.mass)}"',
            f'                fullinertia="{inertia}"/>',
            "    </body>",
            "  </worldbody>",
            "</mujoco>",
        ]
    )


def ur(body: InertialParameters, name: str, remarks: list[str], known: bool) -> str:
    """Return the call of a Universal Robots program; inertia only if it is known."""
    numbers = f"{_number(body.mass)}, {_listed(body.com)}"
    if known:
        numbers += f", {_listed(value for _, value in _diagonal_first(body))}"
    lines = [f"# {remark}" for remark in remarks]
    return "\n".join([*lines, f"set_target_payload({numbers})"])


def franka(body: InertialParameters, name: str, remarks: list[str], known: bool) -> str:
    """Return the request of franka_msgs/srv/SetLoad as yaml, the matrix column by column."""
    request = {
        "mass": _number(body.mass),
        "center_of_mass": _listed(body.com),
        "load_inertia": _listed(body.inertia_com.T.ravel()),
    }
    lines = [f"# {remark}" for remark in remarks]
    return "\n".join([*lines, *(f"{key}: {value}" for key, value in request.items())])


def xarm(body: InertialParameters, name: str, remarks: list[str], known: bool) -> str:
    """Return the request of xarm_msgs/srv/SetTcpLoad as yaml; its centre of mass is in mm."""
    lines = [f"# {remark}" for remark in [*remarks, "weight in kg, center_of_gravity in mm"]]
    request = [f"weight: {_number(body.mass)}", f"center_of_gravity: {_listed(1e3 * body.com)}"]
    return "\n".join([*lines, *request])


def kuka(body: InertialParameters, name: str, remarks: list[str], known: bool) -> str:
    """Return KRL's LOAD: kg; centre in mm; principal axes as Z-Y-X angles, deg; kg m^2 about them.

    R = R_z(A) R_y(B) R_x(C), whose columns are the principal axes in the axes of the flange.
    """
    moments, axes = np.linalg.eigh(body.inertia_com)
    axes = axes * np.sign(np.linalg.det(axes))
    a, b, c = (
        np.arctan2(axes[1, 0], axes[0, 0]),
        np.arctan2(-axes[2, 0], np.hypot(axes[0, 0], axes[1, 0])),
        np.arctan2(axes[2, 1], axes[2, 2]),
    )
    centre = _named("XYZ", 1e3 * body.com) + "," + _named("ABC", np.degrees([a, b, c]))
    load = f"{{M {_number(body.mass)},CM {{{centre}}},J {{{_named('XYZ', moments)}}}}}"
    return "\n".join([*(f"; {remark}" for remark in remarks), f"DECL LOAD {name}={load}"])


def control_toolbox(body: InertialParameters, name: str, remarks: list[str], known: bool) -> str:
    """Return parameters of control_filters/GravityCompensation, without its frames."""
    lines = [
        *(f"# {remark}" for remark in remarks),
        "sensor_frame: FILL_IN",
        "world_frame: FILL_IN",
    ]
    tool = [f"  mass: {_number(body.mass)}", f"  pos: {_listed(body.com)}"]
    return "\n".join([*lines, "tool:", *tool, f"  gravity_field: [0.0, 0.0, {-STANDARD_GRAVITY}]"])


def admittance_controller(
    body: InertialParameters, name: str, remarks: list[str], known: bool
) -> str:
    """Return `gravity_compensation` of ros2_controllers' admittance controller: weight in N."""
    return "\n".join(
        [
            *(f"# {remark}" for remark in remarks),
            "gravity_compensation:",
            "  frame: {id: FILL_IN}",
            "  CoG:",
            f"    pos: {_listed(body.com)}",
            f"    force: {_number(STANDARD_GRAVITY * body.mass)}",
        ]
    )


def moveit(body: InertialParameters, name: str, remarks: list[str], known: bool) -> str:
    """Return moveit_msgs/AttachedCollisionObject as yaml; without a shape, an equivalent box."""
    return attached_object(body, name, remarks, None)


def _named(names: str, values: Iterable[float]) -> str:
    """Return components as KRL writes them."""
    return ",".join(f"{key} {_number(float(v))}" for key, v in zip(names, values, strict=True))


def _six(body: InertialParameters) -> list[tuple[str, float]]:
    """Return the upper triangle of the inertia about the centre of mass by name, row by row."""
    axes = "xyz"
    return [
        (f"i{axes[i]}{axes[j]}", float(body.inertia_com[i, j]))
        for i in range(3)
        for j in range(i, 3)
    ]


def _diagonal_first(body: InertialParameters) -> list[tuple[str, float]]:
    """Return the same with the moments first: xx, yy, zz, xy, xz, yz."""
    return sorted(_six(body), key=lambda entry: entry[0][1] != entry[0][2])


def _attributes(body: InertialParameters) -> list[str]:
    return [f'{key}="{_number(value)}"' for key, value in _six(body)]


def _number(value: float) -> str:
    return f"{value:.{_DIGITS}g}"


def _spaced(values: Iterable[float]) -> str:
    return " ".join(_number(float(value)) for value in values)


def _listed(values: Iterable[float]) -> str:
    return json.dumps([float(_number(float(value))) for value in values])


def _comment(remarks: list[str]) -> list[str]:
    """Return a comment of XML, which may not hold two dashes in a row."""
    return ["  <!--", *(f"    {remark.replace('--', '- -')}" for remark in remarks), "  -->"]


FORMATS: dict[str, Writer] = {
    "urdf": urdf,
    "sdf": sdf,
    "mjcf": mjcf,
    "ur": ur,
    "franka": franka,
    "xarm": xarm,
    "kuka": kuka,
    "control_toolbox": control_toolbox,
    "admittance_controller": admittance_controller,
    "moveit": moveit,
}
"""Writer of each format."""
_WITHOUT_INERTIA = ("ur", "xarm", "control_toolbox", "admittance_controller")
"""Formats that take mass and centre of mass without an inertia."""
_FRAME = dict.fromkeys(("ur", "franka", "xarm", "kuka"), "the robot's flange") | dict.fromkeys(
    ("control_toolbox", "admittance_controller"), "the force sensor's frame, named below"
)
"""What the frame of the object's pose has to be for robots and controllers."""


@dataclass(frozen=True)
class Export:
    """A block and what it does not have.

    Attributes:
        text: the block.
        left_out: what the estimate has and the block has not, one sentence each.
        doubts: what speaks against using the numbers, one sentence each; the block has them too.
    """

    text: str
    left_out: tuple[str, ...]
    doubts: tuple[str, ...] = ()


def export(
    estimate: InertialEstimate,
    form: str,
    source: str = "",
    name: str = "object",
    doubts: Sequence[str] = (),
    shape: ObjectShape | None = None,
) -> Export:
    """Write an estimate as a block of a simulator or robot.

    Args:
        estimate: what was found.
        form: of FORMATS.
        source: the recording, for the comment.
        name: of the link or model.
        doubts: sentences on why the numbers should not be used; they begin the comment.
        shape: of the object, in the axes of its pose, for the format that takes one.

    Raises:
        BadInputError: there is no such format, or it takes no shape.
        NotIdentifiableError: the recording does not determine what the format needs.
    """
    if form not in FORMATS:
        raise BadInputError(f"export {form}: expected one of {', '.join(FORMATS)}")
    if shape is not None and form != "moveit":
        raise BadInputError(f"export {form}: it takes no shape, only moveit does")
    open_inertia = any(one.startswith("inertia") for one in estimate.not_excited)
    _require_known(estimate, form, form in _WITHOUT_INERTIA or shape is not None)
    left_out = _left_out(estimate, open_inertia)
    remarks = [f"WARNING: {doubt}" for doubt in doubts] + _remarks(estimate, source, form)
    remarks += [f"left out: {line}" for line in left_out]
    if shape is None:
        text = FORMATS[form](estimate.inertia, name, remarks, not open_inertia)
    else:
        text = attached_object(estimate.inertia, name, remarks, shape)
    return Export(text + "\n", tuple(left_out), tuple(doubts))


def _require_known(estimate: InertialEstimate, form: str, without_inertia: bool) -> None:
    """Check that the recording determines what the format needs, perhaps `without_inertia`.

    Raises:
        NotIdentifiableError: it does not.
    """
    needed = [
        name
        for name in estimate.not_excited
        if not (without_inertia and name.startswith("inertia"))
    ]
    if not needed:
        return
    hint = ""
    if all(name.startswith("inertia") for name in needed):
        hint = f"; {', '.join(_WITHOUT_INERTIA)} take mass and centre of mass alone"
    raise NotIdentifiableError(
        f"export {form}: this recording does not determine {', '.join(needed)}, and a presumed "
        f"value is no estimate; turn and shake the object about all axes{hint}"
    )


def _remarks(estimate: InertialEstimate, source: str, form: str) -> list[str]:
    """Return what a reader of the block should know."""
    std = estimate.parameter_std
    centre = ", ".join(f"{1e3 * one:.2g}" for one in std[1:4])
    moments = ", ".join(f"{one:.2g}" for one in std[[4, 6, 9]])
    lines = [
        f"estimated from {source or 'a recording'}: {estimate.duration:.1f} s, error "
        f"{estimate.error.whitened_rms:.2f} times the sensor noise",
        f"standard deviations: mass {std[0]:.2g} kg, centre of mass {centre} mm, moments of "
        f"inertia {moments} kg m^2",
        "frame: that of the object's pose in the recording; inertia about the centre of mass",
    ]
    if form in _FRAME:
        lines.append(f"valid only if that frame is {_FRAME[form]}")
    return lines


def _left_out(estimate: InertialEstimate, open_inertia: bool) -> list[str]:
    """Return what the block cannot hold."""
    lines = ["inertia, which this recording does not determine"] if open_inertia else []
    if estimate.effects:
        lines.append(f"effects of the model: {', '.join(estimate.effects)}")
    return [*lines, "friction, which this recording does not measure"]
