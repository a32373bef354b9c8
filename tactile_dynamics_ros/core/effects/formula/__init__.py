"""Effects that are written as formulas in a yaml file."""

from tactile_dynamics_ros.core.effects.formula.effect import FormulaEffect
from tactile_dynamics_ros.core.effects.formula.file import load_effects

__all__ = ["FormulaEffect", "load_effects"]
