"""A tool that is carried with the object, taken out of what is published."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.inertia.batch.knowledge import without_tool
from tactile_dynamics_ros.recording.yaml_files import read_body
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import Shell

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
        """Return the estimate without the tool; None while less than the tool is felt."""
        if self._tool is None:
            return estimate
        try:
            return without_tool(estimate, self._tool)
        except BadInputError as error:
            self._node.faults.add("less_than_tool", str(error))
            return None
