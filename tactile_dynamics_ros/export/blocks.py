"""A rigid body as text that simulators and robots read."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable

from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters

Writer = Callable[[InertialParameters, str, list[str], bool], str]
"""(body, name, remarks, whether the inertia is known) -> text."""

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
