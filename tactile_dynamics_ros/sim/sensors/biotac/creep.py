"""Time-dependence of the skin: creep, hysteresis, and what they do to a load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.sim.sensors.biotac.configuration import BioTacConfig

Array = NDArray[np.float64]

FAST, SLOW = 0.2, 4.0


class ViscoelasticLoad:
    """The load that the indentation follows when the true load is applied.

    A share of the response lags with 0.2 s and another with 4 s (under constant force the skin
    creeps, under constant indentation the force relaxes); a rate-independent friction loop of the
    Dahl type separates loading from unloading.
    """

    def __init__(self, count: int, config: BioTacConfig) -> None:
        self._config = config
        self._fast = np.zeros((count, 4))
        self._slow = np.zeros((count, 4))
        self._last = np.zeros(count)
        self._loop = np.zeros(count)

    def follow(self, load: Array, dt: float) -> Array:
        """Return the effective load (U, 4) [press, traction] for the true one after ``dt``."""
        config = self._config
        self._fast += (1.0 - np.exp(-dt / FAST)) * (load - self._fast)
        self._slow += (1.0 - np.exp(-dt / SLOW)) * (load - self._slow)
        change = load[:, 0] - self._last
        self._last = load[:, 0].copy()
        step = np.abs(change) / (0.15 + 0.25 * load[:, 0])
        self._loop += (np.sign(change) - self._loop) * (1.0 - np.exp(-step))
        direct = 1.0 - config.creep_fast - config.creep_slow
        effective = direct * load + config.creep_fast * self._fast + config.creep_slow * self._slow
        effective[:, 0] *= 1.0 - 0.5 * config.hysteresis * self._loop
        return effective
