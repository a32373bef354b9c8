"""Fits with effects in a process of their own, of one part and of two."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.live import LiveEstimate
from tactile_dynamics_ros.core.inertia.live.refit import (
    LEAST_SPAN,
    RefitConfig,
    RefittedModel,
    fit_live,
)
from tactile_dynamics_ros.core.planar.filter.record import PushWindow
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.diagnostics import Faults
from tactile_dynamics_ros.ros.pushing_streams import PushingStreams
from tactile_dynamics_ros.ros.shell import Shell

REST = 0.5
"""Pause after a fit, in multiples of the time that it took: two thirds of a core at most."""


class Refitter:
    """Starts fits when they are due and takes them over when they are finished.

    Args:
        faults: where fits that fail are counted.
        config: settings of the model.
    """

    def __init__(self, faults: Faults, config: RefitConfig) -> None:
        self.model = RefittedModel(config)
        self._faults = faults
        self._background: Background | None = None
        self._running: tuple[tuple[str, ...], Future[LiveEstimate]] | None = None
        self._started = self._rest_until = 0.0

    @property
    def progress(self) -> str:
        """Sentence that says how far the first fit is."""
        span = self.model.window.span
        if self._running is None:
            return f"{span:.1f} s measured of {LEAST_SPAN:g} s that a fit needs"
        effects, _ = self._running
        since = time.monotonic() - self._started
        return f"fitting {', '.join(effects)} to the last {span:.0f} s, since {since:.0f} s"

    @property
    def outlook(self) -> str:
        """Sentence that says what the present effects are fitted to."""
        if not self.model.effects:
            return "rigid body alone"
        names, span = ", ".join(self.model.effects), self.model.window.span
        if span < LEAST_SPAN:
            return f"{names} will be fitted once {LEAST_SPAN:g} s of a grasp were measured"
        return f"{names} will be fitted to the last {span:.0f} s in which the object was held"

    def set_effects(self, effects: Sequence[str]) -> None:
        """Change the model; its first fit starts at once.

        Raises:
            BadInputError: an effect is unknown or named twice.
        """
        self.model.set_effects(effects)
        self._rest_until = 0.0
        if effects:
            self._begin()

    def advance(self) -> LiveEstimate | None:
        """Do what is due; return the newest fit of the present model, None before the first."""
        now = time.monotonic()
        if self._running is not None and self._running[1].done():
            (effects, future), self._running = self._running, None
            self._rest_until = now + REST * (now - self._started)
            try:
                self.model.take(effects, future.result())
            except TactileDynamicsError as error:
                self._faults.add("not_fitted", str(error))
        due = self._running is None and now >= self._rest_until and self.model.is_due
        if due:
            streams, effects = self.model.begin()
            self._started = now
            self._running = effects, self._begin().submit(fit_live, streams, effects)
        return self.model.newest_fit

    def _begin(self) -> Background:
        """The process of the fits, started when it is first needed."""
        if self._background is None:
            self._background = Background()
        return self._background

    def close(self) -> None:
        """End what runs."""
        if self._background is not None:
            self._background.close()


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
