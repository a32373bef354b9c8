"""Ask about a model, and once more where the noise may be other than stated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from tactile_dynamics_ros.core.discrepancy.model import ResidualModel


class Outcome(Protocol):
    """What a diagnosis and an explanation have in common."""

    @property
    def verdict(self) -> str:
        """One of adequate, missing_effect, ambiguous and unexplained."""

    @property
    def leaves_noise(self) -> bool:
        """Whether the residual, with all that was added, is the white noise that was stated."""


Answer = TypeVar("Answer", bound=Outcome)
Model = TypeVar("Model", bound=ResidualModel)


def ask_twice(
    ask: Callable[[Model], Answer], model: Model, otherwise: Callable[[], Model | None]
) -> tuple[Answer, Model]:
    """Ask; if nothing explains the residual, ask about the same model with other noise.

    Args:
        ask: `diagnose` or `explain`.
        model: with the noise that is stated.
        otherwise: makes the model with the noise that samples show, or None.

    Returns:
        The answer, the second one only if it leaves nothing but noise, and the model asked about.
    """
    answer = ask(model)
    other = otherwise() if answer.verdict == "unexplained" else None
    again = None if other is None else ask(other)
    if other is None or again is None or not again.leaves_noise:
        return answer, model
    return again, other
