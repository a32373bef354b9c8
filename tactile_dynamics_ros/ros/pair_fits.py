"""Fits to the pushes of an object of two parts, beside the messages of the node that pushes it."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.planar.filter.record import PushWindow
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.pushing_streams import PushingStreams
from tactile_dynamics_ros.ros.shell import Shell

LONGEST = 30.0
"""Touch that fits look at, the latest, s: as property_estimator does for a single part."""


class PairFits:
    """Keeps what is measured of both parts, and fits it when asked to.

    Args:
        node: that listens.
        contacts: names of what may touch.
        background: where fits run.

    Attributes:
        found: the last fit, as `estimate --json` tells it; None before the first.
        said: the same in lines for people. refused: why the last one failed; empty if it did not.
    """

    def __init__(self, node: Shell, contacts: tuple[str, ...], background: Background) -> None:
        self.found: dict[str, Any] | None = None
        self.said: list[str] = []
        self.refused = ""
        self._window, self._background = PushWindow(LONGEST), background
        window = self._window
        self._streams = PushingStreams(node, contacts, window, window.clear, window.second)
        self._fitting: Future[Any] | None = None

    @property
    def busy(self) -> bool:
        """Whether a fit runs."""
        return self._fitting is not None

    def ask(self) -> None:
        """Begin a fit to all pushes so far."""
        try:
            self._fitting = self._background.submit(estimate, self._window.streams())
        except TactileDynamicsError as error:
            self.refused = str(error)

    def advance(self) -> None:
        """Take what has come, and a fit that is finished."""
        self._streams.release()
        if self._fitting is None or not self._fitting.done():
            return
        fitting, self._fitting = self._fitting, None
        try:
            fit = fitting.result()
        except TactileDynamicsError as error:
            self.refused = str(error)
            return
        self.refused, self.found, self.said = "", fit.to_document(), fit.lines()

    def values(self, part: int) -> dict[str, float]:
        """Numbers of a part and their std by name, as a status of property_estimator has them."""
        if self.found is None:
            return {}
        told: dict[str, float] = {}
        for name, entry in self.found["links"][part].items():
            if name == "com":
                for k, axis in enumerate(("com_x", "com_y")):
                    told |= {axis: entry["value"][k], f"{axis}_std": entry["std"][k]}
            elif name != "carried_at":
                told |= {name: entry["value"], f"{name}_std": entry["std"]}
        return told
