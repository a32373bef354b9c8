"""What every parameter of every effect states, whatever the model."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EffectParameter:
    """One scalar parameter of an effect.

    Attributes:
        name: short symbol, as in the formula of the effect.
        unit: SI.
        prior_std: scale of plausible values about zero; weak, for conditioning.
        description: one phrase.
        typical: a value at which the effect is plainly present; for checks and pictures.
    """

    name: str
    unit: str
    prior_std: float
    description: str
    typical: float = 0.0

    def __post_init__(self) -> None:
        """Fill the typical value."""
        if self.typical == 0.0:
            object.__setattr__(self, "typical", 0.2 * self.prior_std)
