"""How drivers of arms take a payload: their service, its request, its answer, their units."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError, nearest
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.ros.conversions import inertia_to_message


@dataclass(frozen=True)
class Driver:
    """A driver's service, and those beside it that are called before and after it.

    Attributes:
        kind: type of the service, package/srv/Name.
        service: its usual name.
        fill: writes a body into a request: with its inertia or without, and the time (s) over which
            the controller goes to it.
        said: whether the driver has taken it, and what it says, from the response.
        needs_inertia: whether a request without inertia would be taken for a body of none.
        before: called first, in the same folder as the service; what they answer does not count.
        after: called when it has succeeded, in the same folder.
    """

    kind: str
    service: str
    fill: Callable[[Any, InertialParameters, bool, float], None]
    said: Callable[[Any], tuple[bool, str]]
    needs_inertia: bool = False
    before: tuple[Driver, ...] = ()
    after: tuple[Driver, ...] = ()

    def load(self) -> type[Any]:
        """Return the type of the service.

        Raises:
            BadInputError: its package is not installed.
        """
        package, _, name = self.kind.split("/")
        try:
            found: type[Any] = getattr(importlib.import_module(f"{package}.srv"), name)
        except (ImportError, AttributeError) as error:
            raise BadInputError(
                f"{self.kind} cannot be imported ({error}); install the arm's driver, or hand the "
                "payload over as text: tactile-dynamics estimate --export"
            ) from error
        return found


def _fill_ur(request: Any, body: InertialParameters, known: bool, transition: float) -> None:
    """kg, m, kg m^2 about the centre of mass."""
    inertia = body.inertia_com if known else np.zeros((3, 3))
    written = InertialParameters(body.mass, body.com, inertia)
    request.payload = inertia_to_message(written, 0.0, "").inertia
    request.transition_time = transition


def _fill_franka(request: Any, body: InertialParameters, known: bool, transition: float) -> None:
    """kg, m in the flange, kg m^2 about the centre of mass column by column."""
    request.mass = float(body.mass)
    request.center_of_mass = [float(value) for value in body.com]
    request.load_inertia = [float(value) for value in body.inertia_com.T.ravel()]


def _fill_xarm(request: Any, body: InertialParameters, known: bool, transition: float) -> None:
    """kg, mm."""
    request.weight = float(body.mass)
    request.center_of_gravity = [1e3 * float(value) for value in body.com]


TOOL = "tactile_dynamics_payload"
"""Name under which a Doosan's controller keeps the payload among its tools."""


def _fill_doosan(request: Any, body: InertialParameters, known: bool, transition: float) -> None:
    """kg, mm; inertia is left at zero: the vendor states neither its unit nor its order."""
    request.name = TOOL
    request.weight = float(body.mass)
    request.cog = [1e3 * float(value) for value in body.com]


def _fill_name(request: Any, body: InertialParameters, known: bool, transition: float) -> None:
    """Name the tool."""
    request.name = TOOL


def _said_doosan(response: Any) -> tuple[bool, str]:
    """Whether it was taken; tools change in manual mode only."""
    why = "no reason given; its tools can be changed in manual mode only"
    return response.success, "" if response.success else why


def _doosan(name: str, service: str) -> Driver:
    """Return a service that takes the name of the tool alone."""
    return Driver(f"dsr_msgs2/srv/{name}", service, _fill_name, _said_doosan)


DRIVERS = {
    "ur": Driver(
        "ur_msgs/srv/SetPayload",
        "/io_and_status_controller/set_payload",
        _fill_ur,
        lambda response: (response.success, ""),
    ),
    "franka": Driver(
        "franka_msgs/srv/SetLoad",
        "/service_server/set_load",
        _fill_franka,
        lambda response: (response.success, response.error),
        needs_inertia=True,
    ),
    "xarm": Driver(
        "xarm_msgs/srv/SetTcpLoad",
        "/xarm/set_tcp_load",
        _fill_xarm,
        lambda response: (response.ret == 0, response.message),
    ),
    "doosan": Driver(
        "dsr_msgs2/srv/ConfigCreateTool",
        "/dsr01/tool/config_create_tool",
        _fill_doosan,
        _said_doosan,
        before=(_doosan("ConfigDeleteTool", "config_delete_tool"),),
        after=(_doosan("SetCurrentTool", "set_current_tool"),),
    ),
}
"""Drivers by the name of their arm, with units as their definitions and manuals have them."""


def driver_of(controller: str) -> Driver:
    """Return the driver of an arm.

    Raises:
        BadInputError: there is no such one.
    """
    if controller not in DRIVERS:
        raise BadInputError(
            f"controller '{controller}'{nearest(controller, DRIVERS)}; expected one of "
            f"{', '.join(DRIVERS)}; other arms: tactile-dynamics estimate --export"
        )
    return DRIVERS[controller]
