"""Robust weights of innovations."""

from __future__ import annotations

import math
from dataclasses import dataclass

_SAMPLES = 500
"""Samples over which the scale of innovations is learnt, five seconds at 100 Hz. Fewer let a fault
of a second raise the scale and be believed; more leave a model that does not fit rejected for
longer."""
_SURPRISE = 2.0
"""How much more than the scale an innovation may add to it: a model that does not fit is learnt
within seconds at the start, where few samples count, but a fault that comes later would have to
last for ten seconds to triple the scale. At 9 five seconds of flipped forces were believed."""
_WORST = 20.0
"""Largest scale in standard deviations: where a model is further off nothing is published
(`live_estimate.GROSS`). Without a bound a fault that lasts would be believed in the end. Below
`GROSS` models that are still published would be learnt no more and be thrown away."""
_DOUBT_SAMPLES = 25
"""Doubtful samples over which the share of those that do not fit is learnt, a quarter of a second
at 100 Hz. Fewer decide by chance, more believe the first of a fault."""
_VETO = 0.1
"""Share of doubtful samples that do not fit from which none is believed: of true ones far less than
one in a hundred exceeds the threshold, and those of a fault that happen to fit are a choice that
biases the estimate. At a quarter the first samples of a fault pass into the estimate; at a few
percent a single outlier (1 / 25 of the average) keeps doubtful samples out."""

_NOISE_SAMPLES = 25
"""Samples over which `Judge.noise` is learnt, a quarter of a second at 100 Hz: clean data reach 1.2
times their scale less than once in an hour. Fewer follow chance, more let the first samples of a
fault in and throw away the first ones after it."""
_FITS, _MISFITS = 1.2, 1.5
"""Error over the noise up to which the scatter of residuals tells how far off the estimate may be,
and from which it does not: of what lasts as long as the recording there are few blocks. The upper
one is that from which the status warns (`live_estimate.MISFIT`); nearer to 1 intervals of clean
data grow by chance, higher ones leave those of hidden effects too small."""
_LASTING_FACTOR = 9.0
"""Factor by which variances grow beside the square of such an error, since it is not white: with 1,
truths of hidden effects were up to 9 standard deviations off in the first ten seconds
(`benchmarks.inertia`, recordings with one effect). More makes intervals of models that fit badly
say nothing."""


def misfit_factor(rms: float) -> float:
    """Factor >= 1 on variances for an error over the noise."""
    share = min(max((rms - _FITS) / (_MISFITS - _FITS), 0.0), 1.0)
    return max(1.0, rms) ** 2 * (1.0 + (_LASTING_FACTOR - 1.0) * share)


@dataclass
class Judge:
    """Robust weights of whitened innovations, relative to how well the model fits lately.

    Attributes:
        huber: relative innovation from which a sample loses weight.
        gate: relative innovation from which it is rejected.
        scale: mean square of innovations, at least 1.
        rejected: samples rejected so far.
        noise: factor >= 1 on variances while the model fits worse than it did before, so that a
            fault that ends leaves the estimate as it was.
    """

    huber: float
    gate: float
    scale: float = 1.0
    rejected: int = 0
    noise: float = 1.0
    _seen: int = 0
    _misfits: float = 0.0
    _mean: float = 1.0

    def weigh(self, square: float, doubtful: bool) -> float:
        """Share of an innovation that is believed.

        Args:
            square: its mean square in units of its predicted variance.
            doubtful: a sensor may be lying; only what fits is believed then.
        """
        relative = math.sqrt(square / self.scale)
        if doubtful:
            weight = self._doubt(relative)
        else:
            self._learn(square)
            weight = 0.0 if relative > self.gate else min(1.0, self.huber / max(relative, 1e-9))
            if weight > 0.0:
                self._mean += (square - self._mean) / _NOISE_SAMPLES
                self.noise = misfit_factor(math.sqrt(self._mean / self.scale))
        self.rejected += weight == 0.0
        return weight

    def _learn(self, square: float) -> None:
        self._seen += 1
        self._misfits *= 1.0 - 1.0 / _DOUBT_SAMPLES
        change = min(square, _SURPRISE * self.scale) - self.scale
        scale = self.scale + change / min(self._seen + 1, _SAMPLES)
        self.scale = min(max(1.0, scale), _WORST**2)

    def _doubt(self, relative: float) -> float:
        fits = relative <= self.huber
        self._misfits += ((not fits) - self._misfits) / _DOUBT_SAMPLES
        return float(fits and self._misfits < _VETO)
