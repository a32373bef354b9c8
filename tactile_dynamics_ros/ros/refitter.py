"""Fits of a model with effects, one after the other, in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Future

from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.live import LiveEstimate
from tactile_dynamics_ros.core.inertia.live.refit import (
    LEAST_SPAN,
    RefitConfig,
    RefittedModel,
    fit_live,
)
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.diagnostics import Faults

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
