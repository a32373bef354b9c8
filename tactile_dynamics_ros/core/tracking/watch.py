"""When a tracker believes what an image shows, keeps quiet, or searches."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.tracking.depth_image import DepthNoiseConfig
from tactile_dynamics_ros.core.tracking.fit import Fit
from tactile_dynamics_ros.core.tracking.links.motion import LinkMotionConfig
from tactile_dynamics_ros.core.tracking.registration import RegistrationConfig
from tactile_dynamics_ros.core.tracking.relocalisation import RelocalisationConfig

NEAR = 0.9
"""Score of a prediction from which on it needs only the last steps of the alignment. Higher repeats
the steps from afar for nothing, lower lets a pose creep along with its error."""


SYMMETRIC_STD = 10.0
"""Standard deviation of turns about an axis of symmetry, rad: more than a whole turn, and so large
that many images do not add up to knowledge (ten minutes of 15 images a second would leave 0.1
rad)."""


class TrackingState(Enum):
    """States of a tracker.

    `HIDDEN`: the image shows too little of the object, its pose is predicted but not told.
    """

    SEARCHING = "searching"
    CHECKING = "checking"
    TRACKING = "tracking"
    HIDDEN = "hidden"


@dataclass(frozen=True)
class VisionTrackerConfig:
    """When a pose is believed, and how well."""

    least_score: float = parameter(0.9, "share of the visible model that must match", "", 0, 1)
    least_visible: float = parameter(0.12, "share of the near side that must be visible", "", 0, 1)
    most_misfit: float = parameter(1.5, "whitened distance of a good alignment", "", 1.0, 10.0)
    patience: float = parameter(0.5, "time without a good image before a search", "s", 0.0, 60.0)
    search_period: float = parameter(0.4, "time between searches", "s", 0.0, 60.0)
    confirmations: int = parameter(3, "good images before a found pose is reported", "", 1, 100)
    information_share: float = parameter(
        0.5, "share of the pixels' information that is independent", "", 0.01, 1.0
    )
    blind_std: float = parameter(
        4e-3, "a direction known worse than this is not known at all", "m", 1e-4, 0.1
    )
    bias_position: float = parameter(3e-4, "error of calibration and model", "m", 0.0, 0.05)
    bias_rotation_deg: float = parameter(0.15, "error of calibration and model", "deg", 0.0, 45.0)
    support: bool = parameter(True, "objects stand on a horizontal plane")
    support_height: float = parameter(0.0, "height of that plane in the world", "m", -10.0, 10.0)
    robot_margin: float = parameter(3e-3, "by which the robot's shapes are enlarged", "m", 0, 0.1)
    planar: bool = parameter(True, "parts on a table only slide and turn on it")
    motion: LinkMotionConfig = field(default_factory=LinkMotionConfig)
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    relocalisation: RelocalisationConfig = field(default_factory=RelocalisationConfig)
    noise: DepthNoiseConfig = field(default_factory=DepthNoiseConfig)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Sighting:
    """Pose of the object in one image.

    Attributes:
        pose: (4, 4) X_WO. covariance: (6, 6) [rotation, position], world axes.
        score: share of the visible model that is where it should be.
        visible: share of the near side that nothing hides.
        points: pixels within the object's reach that show neither robot nor support, 0 where not
            known. misfit: root of the mean squared whitened distance of those that were used.
    """

    pose: Array
    covariance: Array
    score: float
    visible: float
    points: int = 0
    misfit: float = 0.0


class Watch:
    """What a tracker knows of one object: seen, hidden, searched, or found and to be checked.

    Args:
        config: thresholds and times.

    Attributes:
        state: what is known now. score: of the last image, 0 where nothing was seen. visible: share
            of the near side that nothing hides.
    """

    def __init__(self, config: VisionTrackerConfig) -> None:
        self.config = config
        self.reset(known=False)

    def reset(self, known: bool) -> None:
        """Begin anew, with or without a pose to check."""
        self.state = TrackingState.CHECKING if known else TrackingState.SEARCHING
        self.score = self.visible = 0.0
        self._good = 0
        self._last_good = self._last_search = -np.inf

    def note(self, fit: Fit | None) -> None:
        """Keep score and visible share of an alignment."""
        self.score = 0.0 if fit is None else fit.score
        self.visible = 0.0 if fit is None else fit.visible

    def believes(self, fit: Fit) -> bool:
        """Whether an alignment is good enough."""
        config = self.config
        return (
            fit.score >= config.least_score
            and fit.visible >= config.least_visible
            and fit.misfit <= config.most_misfit
        )

    def miss(self, time: float) -> bool:
        """Note an image without a good alignment; return whether it is time to search."""
        self._good = 0
        known = self.state in (TrackingState.TRACKING, TrackingState.HIDDEN)
        if known and time - self._last_good < self.config.patience:
            self.state = TrackingState.HIDDEN
            return False
        self.state = TrackingState.SEARCHING
        if time - self._last_search < self.config.search_period:
            return False
        self._last_search = time
        return True

    def accept(self, time: float) -> None:
        """Note a good alignment."""
        self._last_good = time
        self._good += 1
        if self._good >= self.config.confirmations or self.state is TrackingState.HIDDEN:
            self.state = TrackingState.TRACKING
        elif self.state is TrackingState.SEARCHING:
            self.state = TrackingState.CHECKING
