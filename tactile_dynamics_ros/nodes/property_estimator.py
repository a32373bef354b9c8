"""Node: pushes of an object on a support to friction force, mass and centre of mass."""

from __future__ import annotations

import time
from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.planar.filter.live import LiveProperties, PropertyConfig
from tactile_dynamics_ros.core.planar.filter.summary import Properties
from tactile_dynamics_ros.core.planar.network.models import pushing_model
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate, estimate
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.conversions import header
from tactile_dynamics_ros.ros.names import PROPERTY_RESET, PROPERTY_STATUS
from tactile_dynamics_ros.ros.object_state import REPEAT
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.pushed_memory import PushMemory
from tactile_dynamics_ros.ros.pusher_streams import PADS, PUSHER
from tactile_dynamics_ros.ros.pushing_streams import PushingStreams
from tactile_dynamics_ros.ros.shape_messages import EstimateMarkers
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.statuses import property_status


@dataclass(frozen=True)
class PropertyEstimatorConfig:
    """What is listened to, and how often is reported what is known."""

    contacts: tuple[str, ...] = parameter(
        (PUSHER, *PADS), "names of the contacts on contact/<name>"
    )
    status_rate_hz: float = parameter(
        10.0, "rate of the status while anything comes", "Hz", 0.1, 100
    )

    effects: tuple[str, ...] = parameter((), "effects of pushes in the model of the fits; live")

    def __post_init__(self) -> None:
        check_ranges(self)


class PropertyEstimatorNode(Shell):
    """Feeds the filter, fits all pushes after each in a process of its own, and tells both."""

    gather = 0.005
    by_arrival = True

    def __init__(self) -> None:
        super().__init__("property_estimator")
        chosen = declare_config(self, PropertyConfig)
        self.live = LiveProperties(chosen, pushing_model(chosen.model))
        self._background = Background()
        self._memory = PushMemory(self)
        self._fitting: Future[PushedEstimate] | None = None
        config = declare_config(
            self, PropertyEstimatorConfig, live=["effects"], on_change=self._change_model
        )
        self._change_model(config)
        self._said, self._said_at, self._renewed = "", -np.inf, -np.inf
        self._streams = PushingStreams(self, config.contacts, self.live, self._forget)
        self._status = self.create_publisher(DiagnosticArray, PROPERTY_STATUS, LATCHED)
        self._markers = EstimateMarkers(self)
        self.serve(PROPERTY_RESET, self.reset)
        self.every(1.0 / config.status_rate_hz, self._tell)

    def destroy_node(self) -> None:
        """Stop the background work too."""
        self._background.close()
        super().destroy_node()

    def reset(self) -> str:
        """Forget all measurements; the outline stays."""
        self._forget()
        return "all measurements forgotten; the outline is kept"

    def process(self) -> None:
        """Take the filter's steps for which everything has come."""
        until = self._streams.release()
        before = self.live.changes
        self.live.advance(until)
        self._memory.inform(self.live)
        if self.live.changes != before:
            self._memory.give_up()
            self._drop_fit()
            self.faults.add("changed", self.live.changed.text if self.live.changed else "")
        self._take_fit()
        streams = self.live.due(until) if self._fitting is None else None
        if streams is not None:
            live = self.live
            self._fitting = self._background.submit(estimate, streams, live.effects, live.known)

    def _change_model(self, config: PropertyEstimatorConfig) -> str:
        """Take other effects; return what they are fitted to."""
        self.live.set_effects([name for name in config.effects if name])
        self._drop_fit()
        pushes = self.live.record.pushes
        if not pushes:
            return "applies from the next push on: nothing was pushed yet"
        return f"will be fitted to the {pushes} pushes that are kept"

    def _forget(self) -> None:
        self.live.reset()
        self._memory.begin_anew()
        self._drop_fit()

    def _drop_fit(self) -> None:
        """Want no fit any longer that was begun before."""
        self._background.drop()
        self._fitting, self._told = None, -np.inf

    def _take_fit(self) -> None:
        """Take over a fit that is finished."""
        if self._fitting is None or not self._fitting.done():
            return
        fitting, self._fitting = self._fitting, None
        try:
            self.live.take_fit(self._memory.combine(fitting.result()))
        except TactileDynamicsError as error:
            self.live.take_fit(None, str(error))
            self.faults.add("not_fitted", str(error))
        self._told = -np.inf

    def _tell(self) -> None:
        """Publish what is known, with the stamp of the newest measurement in it."""
        known, tracker = self.live.properties(), self.live.tracker
        until = -np.inf if known is None or tracker is None else tracker.time
        now, state, fresh = time.monotonic(), self._streams.state, until > self._told
        self._renewed = now if fresh else self._renewed
        if not fresh and state.name == self._said and now - self._said_at < REPEAT:
            return
        self._told, self._said, self._said_at = until, state.name, now
        message = DiagnosticArray(header=header(max(until, 0.0), "object"))
        statuses = property_status(known, self.live, state)
        message.status = [state.status(now - self._renewed), *statuses, *self._memory.statuses()]
        self._status.publish(message)
        if known is not None and fresh:
            self._mark(known, until)

    def _mark(self, known: Properties, stamp: float) -> None:
        """Show the centre of mass, at the height of the object's frame, where it is known."""
        if self._streams.pose is None:
            return
        self._markers.add_pose(self._streams.pose)
        (x, x_std), (y, y_std) = (known.values[name] for name in ("com_x", "com_y"))
        com = None if "com" in known.undetermined else np.array([x, y, 0.0])
        self._markers.publish(stamp, com, np.array([x_std, y_std, 0.0]))


def main() -> int:
    """Run the node."""
    return run_node(PropertyEstimatorNode)
