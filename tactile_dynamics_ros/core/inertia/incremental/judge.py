"""Robust weights of innovations."""

from __future__ import annotations

import math
from dataclasses import dataclass

_SAMPLES = 500
_CLIP = 9.0


@dataclass
class Judge:
    """Robust weights of whitened innovations, relative to how well the model fits lately."""

    huber: float
    gate: float
    scale: float = 1.0
    rejected: int = 0

    def weigh(self, square: float, doubtful: bool) -> float:
        """Share of an innovation that is believed.

        Args:
            square: its mean square in units of its predicted variance.
            doubtful: a finger fell silent while it pressed; only what fits is believed then.
        """
        relative = math.sqrt(square / self.scale)
        if not doubtful:
            change = min(square, _CLIP * self.scale) - self.scale
            self.scale = max(1.0, self.scale + change / _SAMPLES)
        if relative > (self.huber if doubtful else self.gate):
            self.rejected += 1
            return 0.0
        return min(1.0, self.huber / max(relative, 1e-9))
