"""Node: hands the estimated payload to the arm's controller, when it is asked to."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.client import Client
from rclpy.task import Future
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError, TactileDynamicsError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    com_inertia_jacobian,
)
from tactile_dynamics_ros.core.rigid_body.rotation import rpy_to_matrix
from tactile_dynamics_ros.ros.carried_load import CarriedLoad
from tactile_dynamics_ros.ros.listening import REQUESTS
from tactile_dynamics_ros.ros.names import CONTACTS, PAYLOAD_APPLY
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.payload_services import Driver, driver_of
from tactile_dynamics_ros.ros.shell import Shell, run_node


@dataclass(frozen=True)
class PayloadConfig:
    """To whom the payload is handed, and what is refused."""

    controller: str = parameter("", "of the arm: ur, franka, xarm or doosan")
    service: str = parameter("", "name of the driver's service; empty: its usual one")
    contacts: tuple[str, ...] = parameter(CONTACTS, "names of the contacts of the estimate")
    maximum_mass: float = parameter(
        0.0, "heaviest payload that the arm may carry; 0 hands nothing over", "kg", 0.0
    )
    mass_share: float = parameter(
        0.05, "widest standard deviation of the mass, as a share of it", "", 1e-4, 1.0
    )
    com_std: float = parameter(
        0.01, "widest standard deviation of the centre of mass along any axis", "m", 1e-5, 1.0
    )
    transition_time: float = parameter(
        1.0, "time over which the controller goes to it, where it can", "s", 0.0, 60.0
    )
    flange_xyz: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "origin of object/pose in the flange", "m"
    )
    flange_rpy: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "axes of object/pose in the flange, roll, pitch, yaw", "rad"
    )
    patience: float = parameter(5.0, "time for the driver's answer", "s", 0.1, 60.0)


class Call(NamedTuple):
    """A service of the driver, and the client of it."""

    driver: Driver
    client: Client


class PayloadWriterNode(Shell):
    """Serves payload/apply; nothing is handed over unless it is called, nor what is in doubt."""

    def __init__(self) -> None:
        super().__init__("payload_writer")
        self._config = declare_config(self, PayloadConfig)
        self._driver: Driver | None = None
        if self._config.controller:
            driver = self._driver = driver_of(self._config.controller)
            name = self._config.service or driver.service
            folder = name.rpartition("/")[0]
            # In a group of its own: the answer comes while the call that asked for it still runs.
            self._group = MutuallyExclusiveCallbackGroup()
            self._before = [self._call(one, f"{folder}/{one.service}") for one in driver.before]
            self._arm = self._call(driver, name)
            self._after = [self._call(one, f"{folder}/{one.service}") for one in driver.after]
        self._carried = CarriedLoad(self, self._config.contacts)
        self._waiting: list[tuple[float, Future]] = []
        self.create_service(Trigger, PAYLOAD_APPLY, self._apply, qos_profile=REQUESTS)
        self.every(0.1, self._give_up, always=True)

    async def _apply(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            driver = self._driver
            if driver is None:
                raise NotIdentifiableError("nothing handed over: parameter controller is not set")
            body, known = self.payload(driver)
            self._require_driver()
            for call in self._before:
                await self._ask(call, body, known)
            for call in (self._arm, *self._after):
                answer = await self._ask(call, body, known)
                response.success, response.message = _said(call, answer, _describe(body, known))
                if not response.success:
                    break
        except TactileDynamicsError as error:
            response.success, response.message = False, str(error)
        self.get_logger().info(response.message)
        return response

    def payload(self, driver: Driver) -> tuple[InertialParameters, bool]:
        """Return the payload in the flange's frame, and whether its inertia is known.

        Args:
            driver: to whom.

        Raises:
            NotIdentifiableError: it is not to be handed over, and why.
        """
        config, load = self._config, self._carried.load
        if load is None or self._carried.trouble:
            raise NotIdentifiableError(f"nothing handed over: {self._carried.trouble}")
        to_com = com_inertia_jacobian(load.body.phi)
        std = np.sqrt(np.diag(to_com @ load.body.covariance @ to_com.T))
        body = InertialParameters.from_dynamic_parameters(load.body.phi)
        open_ones = [name for name in load.body.undetermined if not name.startswith("inertia")]
        reasons = [f"{name} is undetermined" for name in open_ones]
        if std[0] > config.mass_share * body.mass:
            reasons.append(f"mass {body.mass:.3g} ± {std[0]:.2g} kg is wider than mass_share")
        if std[1:4].max() > config.com_std:
            reasons.append(f"centre of mass ± {1e3 * std[1:4].max():.2g} mm is wider than com_std")
        if body.mass > config.maximum_mass:
            reasons.append(
                f"{body.mass:.3g} kg is more than maximum_mass = {config.maximum_mass:g} kg"
            )
        moments = np.diag(body.inertia_com)
        known = not any(name.startswith("inertia") for name in load.body.undetermined)
        known = known and bool(np.all(std[[4, 6, 9]] < moments))
        if driver.needs_inertia and not known:
            reasons.append("its inertia is not known, and this controller needs it")
        if reasons:
            raise NotIdentifiableError(f"nothing handed over: {'; '.join(reasons)}")
        turn = rpy_to_matrix(np.array(config.flange_rpy))
        place = turn @ body.com + np.array(config.flange_xyz)
        return InertialParameters(body.mass, place, turn @ body.inertia_com @ turn.T), known

    def _call(self, driver: Driver, name: str) -> Call:
        return Call(driver, self.create_client(driver.load(), name, callback_group=self._group))

    def _require_driver(self) -> None:
        """Check that all services of the driver are there, before any is called.

        Raises:
            NotIdentifiableError: one is not.
        """
        for call in (*self._before, self._arm, *self._after):
            if not call.client.service_is_ready():
                name = call.client.srv_name
                text = f"nothing handed over: {name} is not there; is the driver running?"
                raise NotIdentifiableError(text)

    async def _ask(self, call: Call, body: InertialParameters, known: bool) -> Any:
        """Return the driver's answer; None if none comes in time.

        Args:
            call: what is asked.
            body: the payload.
            known: whether its inertia is known.
        """
        request = call.client.srv_type.Request()
        call.driver.fill(request, body, known, self._config.transition_time)
        answer = call.client.call_async(request)
        self._waiting.append((time.monotonic() + self._config.patience, answer))
        return await answer

    def _give_up(self) -> None:
        """End waiting for answers that do not come."""
        now = time.monotonic()
        for deadline, answer in self._waiting:
            if now > deadline and not answer.done():
                answer.set_result(None)
        self._waiting = [entry for entry in self._waiting if not entry[1].done()]


def _said(call: Call, response: Any, text: str) -> tuple[bool, str]:
    """Return whether the driver has taken the payload, and a sentence."""
    if response is None:
        return False, f"{call.client.srv_name} did not answer; it may have {text}"
    taken, said = call.driver.said(response)
    return taken, f"handed over: {text}" if taken else f"refused by the driver: {said or text}"


def _describe(body: InertialParameters, known: bool) -> str:
    centre = ", ".join(f"{1e3 * value:.1f}" for value in body.com)
    text = f"{body.mass:.4g} kg, centre ({centre}) mm in the flange's frame"
    return text if known else f"{text}, without inertia"


def main() -> int:
    """Run the node."""
    return run_node(PayloadWriterNode)
