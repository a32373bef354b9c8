"""Tool and load that an arm carries, and the services that take a payload."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import BadInputError, nearest
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.inertia.batch.knowledge import without_tool
from tactile_dynamics_ros.core.inertia.compensation import Load
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.recording.yaml_files import read_body
from tactile_dynamics_ros.ros.conversions import inertia_to_message
from tactile_dynamics_ros.ros.names import ESTIMATOR_STATUS
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import LATCHED, Shell
from tactile_dynamics_ros.ros.statuses import body_of_status


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
        takes_tool: whether it means all that the flange carries; if not, the load beside a tool
            that the controller knows by itself.
        before: called first, in the same folder as the service; what they answer does not count.
        after: called when it has succeeded, in the same folder.
    """

    kind: str
    service: str
    fill: Callable[[Any, InertialParameters, bool, float], None]
    said: Callable[[Any], tuple[bool, str]]
    needs_inertia: bool = False
    takes_tool: bool = True
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
    """kg, m, kg m^2 about the centre of mass; Jazzy's ur_msgs takes mass and centre alone."""
    if not hasattr(request, "payload"):
        request.mass, centre = float(body.mass), request.center_of_gravity
        centre.x, centre.y, centre.z = (float(value) for value in body.com)
        return
    inertia = body.inertia_com if known else np.zeros((3, 3))
    written = InertialParameters(body.mass, body.com, inertia)
    request.payload = inertia_to_message(written, 0.0, "").inertia
    request.transition_time = transition


def _fill_other(request: Any, body: InertialParameters, known: bool, transition: float) -> None:
    """kg, m, kg m^2 about the centre of mass, and whether that is known."""
    _fill_ur(request, body, known, transition)
    request.inertia_known = known


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
        takes_tool=False,
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
    "other": Driver(
        "tactile_dynamics_msgs/srv/SetPayload",
        "/arm/set_payload",
        _fill_other,
        lambda response: (response.success, response.message),
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


@dataclass(frozen=True)
class LoadConfig:
    """Where the load is known from."""

    load: str = parameter(
        "", "file of what is carried, as estimate --save; empty: of inertial_estimator"
    )


@dataclass(frozen=True)
class LearningConfig:
    """Whether the load may change."""

    learn: bool = parameter(
        True,
        "whether the newest estimate is taken over, and has to be adequate now; false keeps the "
        "load as it is: set it before contact, which spoils estimates",
    )


class CarriedLoad:
    """Follows what is carried.

    Args:
        node: whose parameters `load` and `learn` say where it is known from.
        contacts: names of the sensors.

    Attributes:
        load: what is carried; None while unknown.
        trouble: why it is not to be believed now; empty if it is.
        learning: whether the newest estimate is taken over.
    """

    def __init__(self, node: Shell, contacts: tuple[str, ...]) -> None:
        self._node, self._contacts = node, contacts
        self.load: Load | None = None
        self.trouble = "no estimate of the load yet"
        file = declare_config(node, LoadConfig).load
        learning = declare_config(node, LearningConfig, live=["learn"], on_change=self._set)
        self.learning = learning.learn and not file
        if file:
            self._take(Load.of_body(read_body(file), contacts))
        else:
            node.listen(DiagnosticArray, ESTIMATOR_STATUS, self._on_status, LATCHED)

    def _set(self, config: LearningConfig) -> str:
        self.learning = config.learn
        if not config.learn and self.load is not None:
            self.trouble = ""
        return "the newest estimate is used" if config.learn else "the load is kept as it is"

    def _on_status(self, message: DiagnosticArray) -> None:
        """Take over the newest estimate, if it is one to be believed."""
        if not self.learning:
            return
        known, self.trouble = body_of_status(message.status)
        if known is not None and not self.trouble:
            self._take(Load.of_body(known, self._contacts))

    def _take(self, load: Load) -> None:
        self.load, self.trouble = load, ""
        self._node.faults.show("load", f"{load.body.phi[0]:.4g} kg of {load.body.name}")
        self._node.faults.show("not_compensated", ", ".join(load.uncompensated) or "none")


Estimate = TypeVar("Estimate", bound=InertialEstimate)


@dataclass(frozen=True)
class ToolConfig:
    """The tool, if there is any."""

    tool: str = parameter("", "file of a tool that is carried too, as estimate --tool; empty: none")


class CarriedTool:
    """Takes a known tool out of estimates.

    Args:
        node: whose parameter `tool` names the file.
    """

    def __init__(self, node: Shell) -> None:
        file = declare_config(node, ToolConfig).tool
        self._node, self._tool = node, read_body(file) if file else None

    def take_out(self, estimate: Estimate) -> Estimate | None:
        """Return the estimate without the tool; None while less than the tool is measured."""
        if self._tool is None:
            return estimate
        try:
            return without_tool(estimate, self._tool)
        except BadInputError as error:
            self._node.faults.add("less_than_tool", str(error))
            return None
