"""Follow the links of an object that is pushed over a table, in the images of a depth camera.

Every link is aligned by itself: it slides and turns on the table. Pixels that show another link
or the robot are left out, so that links may hide each other; the table is what is seen past a
border. A link that is not where it should be is not told, and searched on the whole table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.tracking.depth_image import (
    Image,
    PinholeCamera,
    Window,
    cut_window,
    window_around,
    without_specks,
)
from tactile_dynamics_ros.core.tracking.fit import draw
from tactile_dynamics_ros.core.tracking.links.link_tracker import Link, LinkTracker
from tactile_dynamics_ros.core.tracking.registration import OBJECT_TOLERANCE
from tactile_dynamics_ros.core.tracking.robot_volume import Volume
from tactile_dynamics_ros.core.tracking.scene import Scene, label_scene
from tactile_dynamics_ros.core.tracking.watch import Sighting, TrackingState, VisionTrackerConfig


@dataclass(frozen=True)
class _View:
    """An image with what is known of camera and robot at its time."""

    depth: Image
    camera: PinholeCamera
    time: float
    positions: Array | None


class TableTracker:
    """Poses of the links of an object on a table.

    Args:
        links: what is followed.
        volume: of the robot that may stand before them; None without.
        config: thresholds, weights, camera noise, height of the table.
    """

    def __init__(
        self,
        links: Sequence[Link],
        volume: Volume | None = None,
        config: VisionTrackerConfig | None = None,
    ) -> None:
        self.config = config or VisionTrackerConfig()
        self.links = tuple(LinkTracker(link, self.config) for link in links)
        self._volume = volume

    @property
    def states(self) -> dict[str, TrackingState]:
        """What is known of each link, by name."""
        return {link.link.name: link.watch.state for link in self.links}

    def update(
        self, depth: Image, camera: PinholeCamera, time: float, positions: Array | None = None
    ) -> dict[str, Sighting]:
        """Take an image; return the pose of each link that is seen for sure, by name.

        Args:
            depth: (H, W) m, NaN where invalid.
            camera: that took it, where it was then.
            time: s, of the image.
            positions: (J,) joints of the robot then, rad or m; None without a robot.

        Raises:
            BadInputError: the image has another size than the camera says.
        """
        camera.check(depth)
        view = _View(depth, camera, time, positions)
        before = [link.motion.pose.copy() for link in self.links]
        found: dict[str, Sighting] = {}
        missed: list[LinkTracker] = []
        motion: Array | None = None
        for link, pose in zip(self.links, before, strict=True):
            seen = self._follow(link, view)
            if seen is not None:
                found[link.link.name] = seen
                motion = seen.pose @ np.linalg.inv(pose) if motion is None else motion
            elif link.watch.state is TrackingState.HIDDEN:
                missed.append(link)
        if motion is not None:
            for link in missed:
                link.carry(motion)
        return found

    def _follow(self, link: LinkTracker, view: _View) -> Sighting | None:
        seeds = link.seeds(view.time)
        scene = self._scene_around(link, view, seeds)
        fit = None if scene is None else link.align(scene, seeds)
        link.watch.note(fit)
        if fit is not None and link.followed and link.jumped(fit, seeds, view.camera.pose):
            fit = None
        if scene is None or fit is None or not link.watch.believes(fit):
            if not link.watch.miss(view.time):
                return None
            whole = slice(0, view.camera.height), slice(0, view.camera.width)
            scene = self._scene(link, view, cut_window(view.camera, view.depth, *whole))
            fit = link.search(scene)
            link.watch.note(fit)
            if fit is None or not link.watch.believes(fit):
                return None
        return link.accept(fit, scene, view.time)

    def _scene_around(self, link: LinkTracker, view: _View, seeds: Sequence[Array]) -> Scene | None:
        """Return the labelled pixels around a link at all of the poses X_WO; None out of sight."""
        shape, to_camera = link.link.shape, np.linalg.inv(view.camera.pose)
        centres = np.stack([(to_camera @ seed)[:3] @ [*shape.centre, 1.0] for seed in seeds])
        centre = centres.mean(axis=0)
        spread = float(np.linalg.norm(centres - centre, axis=1).max())
        radius = shape.radius + self.config.registration.coarse_reach + spread
        window = window_around(view.camera, view.depth, centre, radius)
        return None if window is None else self._scene(link, view, window)

    def _scene(self, link: LinkTracker, view: _View, window: Window) -> Scene:
        """Return labelled pixels that show neither robot, table, nor another link."""
        support = self.config.support_height if self.config.support else None
        scene = label_scene(
            view.camera, without_specks(window), self._volume, view.positions, self.config.noise,
            support,
        )  # fmt: skip
        taken = np.zeros(len(scene.free), dtype=bool)
        own = _miss(link, scene, view.time) if link.followed else np.full(len(taken), np.inf)
        for other in self.links:
            if other is not link and other.followed:
                miss = _miss(other, scene, view.time)
                taken |= (miss < OBJECT_TOLERANCE) & (miss < own)
        return replace(scene, free=scene.free & ~taken)


def _miss(link: LinkTracker, scene: Scene, time: float) -> Array:
    """Return how far each pixel (P,) is off the surface that a link shows there, m.

    Infinite where it shows none.
    """
    pose = np.linalg.inv(scene.camera.pose) @ link.motion.predicted(time)
    drawing = draw(link.link.shape, scene, pose, 1.0)
    covered = drawing.mask.ravel() & np.isfinite(scene.window.depth)
    return np.where(covered, np.abs(scene.window.depth - drawing.depth), np.inf)
