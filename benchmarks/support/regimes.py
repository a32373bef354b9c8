"""Recordings in which something acts only while a quantity lies within bounds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.calibration import magnitude_for_whitened_rms
from tactile_dynamics_ros.synthetic.effects import create_hidden_effect
from tactile_dynamics_ros.synthetic.effects.base import Bounds, Gated
from tactile_dynamics_ros.synthetic.effects.measurement import ForceScale
from tactile_dynamics_ros.synthetic.grasp import FINGERS
from tactile_dynamics_ros.synthetic.recordings import HiddenRecording, record
from tactile_dynamics_ros.synthetic.scenario import Scenario, ScenarioOptions, Truth

Draw = Callable[[np.random.Generator, "Path"], Bounds]


@dataclass(frozen=True)
class Path:
    """What a scenario without effects goes through; bounds are drawn from its quantiles."""

    truth: Truth

    def values(self, quantity: str) -> np.ndarray:
        """(N,) of a quantity."""
        motion = self.truth.scene.motion
        if quantity == "t":
            return motion.time - motion.time[0]
        if quantity in "xyz":
            return motion.position[:, "xyz".index(quantity)]
        if quantity in ("speed", "turn"):
            rates = motion.velocity if quantity == "speed" else motion.angular_velocity
            return np.linalg.norm(rates, axis=1)
        finger = FINGERS.index(quantity.removeprefix("load_"))
        return np.linalg.norm(self.truth.contact_force[:, finger], axis=1)

    def below(self, quantity: str, share: float) -> Bounds:
        """The lowest share of a quantity."""
        return Bounds(quantity, high=float(np.quantile(self.values(quantity), share)))

    def above(self, quantity: str, share: float) -> Bounds:
        """The highest share of a quantity."""
        return Bounds(quantity, low=float(np.quantile(self.values(quantity), 1.0 - share)))

    def between(self, quantity: str, start: float, share: float) -> Bounds:
        """A share of a quantity from a quantile on."""
        low, high = np.quantile(self.values(quantity), [start, start + share])
        return Bounds(quantity, float(low), float(high))


CASES: dict[str, tuple[str, Draw]] = {
    "drag below the water line": (
        "viscous_drag",
        lambda rng, path: path.below("z", rng.uniform(0.25, 0.45)),
    ),
    "cable taut beyond a place": (
        "tether_spring",
        lambda rng, path: path.above("x", rng.uniform(0.25, 0.45)),
    ),
    "wall in one corner": (
        "unsensed_contact",
        lambda rng, path: path.above("y", rng.uniform(0.2, 0.4)),
    ),
    "gain too high under load": (
        "force_scale",
        lambda rng, path: path.above(f"load_{FINGERS[rng.integers(3)]}", rng.uniform(0.25, 0.45)),
    ),
    "hung on for a while": (
        "hanging_cable",
        lambda rng, path: path.between("t", rng.uniform(0.25, 0.5), rng.uniform(0.2, 0.3)),
    ),
    "bias from a time on": (
        "force_bias",
        lambda rng, path: path.above("t", rng.uniform(0.3, 0.6)),
    ),
    "drag at speed": (
        "quadratic_drag",
        lambda rng, path: path.above("speed", rng.uniform(0.25, 0.45)),
    ),
    "motor that runs for a while": (
        "spinning_rotor",
        lambda rng, path: path.between("t", rng.uniform(0.2, 0.5), rng.uniform(0.25, 0.35)),
    ),
}
"""Name of what acts and where, by what it is in the world."""


def generate_in_regime(
    seed: int, case: str, error: float = 2.0, options: ScenarioOptions | None = None
) -> HiddenRecording:
    """Generate a recording with one effect that raises the whitened error in its regime.

    Args:
        seed: of everything.
        case: of `CASES`.
        error: whitened error inside, 1 outside.
        options: of the scenario.
    """
    scenario = Scenario.draw(seed, options)
    name, draw = CASES[case]
    path = Path(scenario.simulate(()))
    bounds = draw(randomness.stream(seed, "bounds", case), path)
    inner = create_hidden_effect(name, 1.0, seed, scenario)
    if isinstance(inner, ForceScale):
        affected = np.array([bounds.quantity == f"load_{finger}" for finger in FINGERS])
        inner = dataclasses.replace(inner, weight=1.0 * affected)
    effect = Gated(1.0, inner, bounds)
    values = path.values(bounds.quantity)
    share = float(np.mean((values > bounds.low) & (values < bounds.high)))
    target = np.sqrt(1.0 + share * (error**2 - 1.0))
    size = magnitude_for_whitened_rms(effect, float(target), scenario)
    return record(scenario, (dataclasses.replace(effect, magnitude=size),), None)


def acts_at(recording: HiddenRecording, time: np.ndarray) -> np.ndarray:
    """(K,) whether the effect of `generate_in_regime` acts at some times, s."""
    effect = recording.effects[0]
    assert isinstance(effect, Gated)
    truth = recording.scenario.simulate(recording.effects)
    values = Path(truth).values(effect.bounds.quantity)
    at = np.interp(time, truth.scene.time, values)
    return np.asarray((at > effect.bounds.low) & (at < effect.bounds.high))
