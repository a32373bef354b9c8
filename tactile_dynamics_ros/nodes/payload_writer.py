"""Node: hands the estimated payload to the arm's controller, when it is asked to."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
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

    controller: str = parameter("", "of the arm: ur, franka or xarm")
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


class PayloadWriterNode(Shell):
    """Serves payload/apply; nothing is handed over unless it is called, nor what is in doubt."""

    def __init__(self) -> None:
        super().__init__("payload_writer")
        self._config = declare_config(self, PayloadConfig)
        self._driver: Driver | None = None
        if self._config.controller:
            self._driver = driver_of(self._config.controller)
            self._kind = self._driver.load()
            name = self._config.service or self._driver.service
            # In a group of its own: the answer comes while the call that asked for it still runs.
            group = MutuallyExclusiveCallbackGroup()
            self._arm = self.create_client(self._kind, name, callback_group=group)
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
            request = self._kind.Request()
            driver.fill(request, body, known, self._config.transition_time)
            text = _describe(body, known)
            response.success, response.message = self._said(driver, await self._ask(request), text)
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

    async def _ask(self, request: Any) -> Any:
        """Return the driver's answer; None if none comes in time.

        Args:
            request: of its service.

        Raises:
            NotIdentifiableError: the driver's service is not there.
        """
        if not self._arm.service_is_ready():
            raise NotIdentifiableError(
                f"nothing handed over: {self._arm.srv_name} is not there; is the driver running?"
            )
        answer = self._arm.call_async(request)
        self._waiting.append((time.monotonic() + self._config.patience, answer))
        return await answer

    def _give_up(self) -> None:
        """End waiting for answers that do not come."""
        now = time.monotonic()
        for deadline, answer in self._waiting:
            if now > deadline and not answer.done():
                answer.set_result(None)
        self._waiting = [entry for entry in self._waiting if not entry[1].done()]

    def _said(self, driver: Driver, response: Any, text: str) -> tuple[bool, str]:
        """Return whether the driver has taken the payload, and a sentence."""
        if response is None:
            return False, f"{self._arm.srv_name} did not answer; it may have {text}"
        taken, said = driver.said(response)
        return taken, f"handed over: {text}" if taken else f"refused by the driver: {said or text}"


def _describe(body: InertialParameters, known: bool) -> str:
    centre = ", ".join(f"{1e3 * value:.1f}" for value in body.com)
    text = f"{body.mass:.4g} kg, centre ({centre}) mm in the flange's frame"
    return text if known else f"{text}, without inertia"


def main() -> int:
    """Run the node."""
    return run_node(PayloadWriterNode)
