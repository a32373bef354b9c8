"""Node: what stands on a table, from depth images of a camera that it moves."""

from __future__ import annotations

import json
import time
from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.task import Future as RosFuture
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.errors import NotIdentifiableError, TactileDynamicsError
from tactile_dynamics_ros.core.shape.superquadric import looking
from tactile_dynamics_ros.core.shape.superquadric.views import ViewConfig
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.camera_motion import CameraMotion
from tactile_dynamics_ros.ros.conversions import depth_to_core, pose_to_message
from tactile_dynamics_ros.ros.emergency import EmergencyStop
from tactile_dynamics_ros.ros.listening import REQUESTS
from tactile_dynamics_ros.ros.names import CAMERA_TARGET, DEPTH_IMAGE, SHAPE_START
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shape_messages import WORLD, ShapePublisher
from tactile_dynamics_ros.ros.shell import Shell, run_node
from tactile_dynamics_ros.ros.support import Support
from tactile_dynamics_ros.ros.wire import Picture, Stamp

PATIENCE = 5.0
"""Real time without an image from where the camera should be, and without a move of it, after which
looking is given up, s."""


@dataclass
class Search:
    """A call of the service that is being answered.

    Attributes:
        looks: so far. answer: where it is awaited. target: (4, 4) where the camera should be.
        stamp: of the last image used. judging: the fit to the looks while that runs.
    """

    looks: looking.Looks
    answer: RosFuture
    target: NDArray[np.float64]
    stamp: Stamp = Stamp(0, 0)
    judging: Future[looking.Sight] | None = None


class ShapeEstimatorNode(Shell):
    """On request looks, moves the camera and looks again, until another look would add little."""

    skimming = True
    gather = 0.01

    def __init__(self) -> None:
        super().__init__("shape_estimator")
        self.config = declare_config(self, looking.LookingConfig)
        self.views = declare_config(self, ViewConfig, "view.")
        self._background = Background()
        self._search: Search | None = None
        self._told = ShapePublisher(self)
        self._target = self.create_publisher(PoseStamped, CAMERA_TARGET, 10)
        self._camera, self._support = CameraMotion(self), Support(self)
        self.stop = EmergencyStop(self, self._halt)
        self.listen(Image, DEPTH_IMAGE, self._on_image, skim=True)
        self.create_service(Trigger, SHAPE_START, self._start, qos_profile=REQUESTS)
        self.every(0.05, self._advance)

    def destroy_node(self) -> None:
        """Stop the background work too."""
        self._background.close()
        super().destroy_node()

    async def _start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Look until the shape is known; the answer comes then."""
        try:
            self.stop.require_released()
            if self._search is not None:
                raise NotIdentifiableError("it is already looking")
            looks = looking.Looks(self.config, self.views, self._support.height())
            self._search = Search(looks, RosFuture(), self._camera.still_at())
        except TactileDynamicsError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = await self._search.answer
        return response

    def _on_image(self, message: Picture) -> None:
        """Use an image if the camera is at rest where it should be."""
        search = self._search
        if search is None or search.judging is not None:
            return
        pose = self._camera.rested_at(search.target, message.stamp)
        intrinsics = self._camera.intrinsics
        if pose is None or intrinsics is None:
            return
        try:
            search.looks.add(depth_to_core(message, DEPTH_IMAGE), intrinsics, pose)
        except TactileDynamicsError as error:
            self._finish(False, str(error))
            return
        search.stamp = message.stamp
        search.judging = self._background.submit(looking.judge, search.looks)

    def _advance(self) -> None:
        """Move on where a fit is finished; give up where nothing comes."""
        search = self._search
        if search is None or (search.judging is not None and not search.judging.done()):
            return
        if search.judging is None:
            if time.monotonic() - self._camera.moved > PATIENCE:
                self._finish(False, self._camera.complaint(search.target))
            return
        judging, search.judging = search.judging, None
        self._camera.wait_anew()
        try:
            self._conclude(search, judging.result())
        except TactileDynamicsError as error:
            self._finish(False, str(error))

    def _conclude(self, search: Search, sight: looking.Sight) -> None:
        """Send the camera on, or publish what it has shown."""
        if sight.view is not None:
            search.looks.take(sight)
            search.target = sight.view.pose
            self._target.publish(pose_to_message(search.target, search.stamp, WORLD))
            return
        self._told.publish(sight.scene.objects[sight.chosen].parts, search.stamp)
        self._finish(True, json.dumps(search.looks.to_json(sight)))

    def _finish(self, success: bool, text: str) -> None:
        if self._search is not None:
            answer, self._search = self._search.answer, None
            answer.set_result((success, text))

    def _halt(self, why: str) -> None:
        """Keep the camera where it is."""
        if self._search is not None:
            self._target.publish(pose_to_message(*self._camera.latest(), WORLD))
            self._finish(False, f"stopped: {why}")


def main() -> int:
    """Run the node."""
    return run_node(ShapeEstimatorNode)
