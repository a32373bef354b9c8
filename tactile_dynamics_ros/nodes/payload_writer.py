"""Node: hands the estimated payload to the arm's controller, when it is asked to."""

from __future__ import annotations

from dataclasses import dataclass

from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError, TactileDynamicsError
from tactile_dynamics_ros.ros.handover import Handover, HandoverConfig
from tactile_dynamics_ros.ros.listening import REQUESTS
from tactile_dynamics_ros.ros.names import CONTACTS, PAYLOAD_APPLY
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.payload_services import CarriedLoad
from tactile_dynamics_ros.ros.shell import Shell, run_node


@dataclass(frozen=True)
class PayloadConfig:
    """What is handed over."""

    contacts: tuple[str, ...] = parameter(CONTACTS, "names of the contacts of the estimate")


class PayloadWriterNode(Shell):
    """Serves payload/apply; nothing is handed over unless it is called, nor what is in doubt."""

    def __init__(self) -> None:
        super().__init__("payload_writer")
        contacts = declare_config(self, PayloadConfig).contacts
        self.handover = Handover(self, declare_config(self, HandoverConfig))
        self._carried = CarriedLoad(self, contacts)
        self.create_service(Trigger, PAYLOAD_APPLY, self._apply, qos_profile=REQUESTS)

    async def _apply(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self.handover.require_controller()
            load = self._carried.load
            if load is None or self._carried.trouble:
                raise NotIdentifiableError(f"nothing handed over: {self._carried.trouble}")
            response.success, response.message = await self.handover.give(load.body)
        except TactileDynamicsError as error:
            response.success, response.message = False, str(error)
        self.get_logger().info(response.message)
        return response


def main() -> int:
    """Run the node."""
    return run_node(PayloadWriterNode)
