"""What is carried, for nodes that take it out: from a file, or as inertial_estimator has it."""

from __future__ import annotations

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.inertia.compensation import Load
from tactile_dynamics_ros.recording.yaml_files import read_body
from tactile_dynamics_ros.ros.names import ESTIMATOR_STATUS
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import LATCHED, Shell
from tactile_dynamics_ros.ros.statuses import body_of_status


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
