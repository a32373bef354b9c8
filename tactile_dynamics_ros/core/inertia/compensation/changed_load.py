"""Whether a contact wrench is that of more, or less, load: mass that hangs and moves along."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array

MEMORIES = (0.25, 1.0)
"""Times over which contact wrenches are forgotten, s: a load that changes at once explains nine
tenths of them after 2.3 times as long. The short one tells within a second of what is plain, the
long one of what noise of the poses hides. Shorter takes pushes of a moment for loads."""
_EXPLAINED = 0.9
"""Share of the contact wrench that a change of the load has to explain: a push 18 deg off the
vertical stays below. Higher tells later of a load, lower takes more pushes for one."""
_BEYOND = 5.0
"""Standard deviations of the load's mass by which the change has to exceed it. Lower warns of clean
data, higher lets through what the interval does not cover."""
_LEAST = 0.02
"""Share of the load that may change without a word: errors of poses and sensors that last for half
a second do a percent of it."""
_PERIOD = 0.008
"""Time between samples that are looked at, s: hundred in a second, since errors of the motion are
alike for several; more cost processor time and tell nothing."""
_FIRST_MOMENTS = 4
"""Columns of the regressor that a change is fitted with: mass and its first moments."""


class ChangedLoad:
    """Fits a change of mass and first moments to the last contact wrenches.

    min |J d - w|^2 over the last moments, J the first four columns of the regressor, in
    units of the noise. Of what is beyond noise, |w|^2 - 6 n, the change explains d^T J^T w.

    Args:
        memory: time over which contact wrenches are forgotten, s.
    """

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self._information = np.zeros((_FIRST_MOMENTS, _FIRST_MOMENTS))
        self._target = np.zeros(_FIRST_MOMENTS)
        self._square = self._count = 0.0
        self._time, self._period = -np.inf, 0.0

    def add(self, time: Array, regressor: Array, wrench: Array, std: Array) -> None:
        """Take contact wrenches.

        Args:
            time: (N,) s.
            regressor: (N, 6, 10).
            wrench: (N, 6) contact wrench, [torque, force].
            std: (N, 6) of it, for a load that is known.
        """
        step = float(time[-1]) - self._time
        if 0.0 < step < _PERIOD:
            return
        keep = float(np.exp(-max(step, 0.0) / self._memory)) if np.isfinite(step) else 0.0
        if np.isfinite(step):
            self._period = max(step, _PERIOD) / len(time)
        rows = (regressor[..., :_FIRST_MOMENTS] / std[..., None]).reshape(-1, _FIRST_MOMENTS)
        white = (wrench / std).ravel()
        self._information = keep * self._information + rows.T @ rows
        self._target = keep * self._target - rows.T @ white
        self._square = keep * self._square + float(white @ white)
        self._count = keep * self._count + len(white)
        self._time = float(time[-1])

    def change(self, mass: float, mass_std: float, correlated: float) -> float:
        """Change of the mass, kg, where it is what the contact wrench shows, else 0.

        Args:
            mass: of the load as it was known, kg.
            mass_std: its standard deviation, kg.
            correlated: time over which errors of the motion are alike, s.
        """
        if self._square == 0.0:
            return 0.0
        weak = 1e-9 * np.trace(self._information) * np.eye(_FIRST_MOMENTS)
        spread = np.linalg.inv(self._information + weak)
        found = spread @ self._target
        beyond = self._square - self._count
        if float(found @ self._target) <= _EXPLAINED * beyond or beyond <= 0.0:
            return 0.0
        alike = max(1.0, correlated / self._period) if self._period > 0.0 else 1.0
        std = np.hypot(mass_std, np.sqrt(alike * spread[0, 0]))
        return float(found[0]) if abs(found[0]) > max(_BEYOND * std, _LEAST * mass) else 0.0
