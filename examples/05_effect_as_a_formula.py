"""How do I add an effect of my own as a formula?

    python examples/05_effect_as_a_formula.py

Prints the check of the formula, and the estimate with it: a brush drags at a simulated object.
"""

import tempfile
from pathlib import Path

import tactile_dynamics_ros as td
from tactile_dynamics_ros.core.effects.check import check_effect
from tactile_dynamics_ros.core.effects.formula import load_effects
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms

BRUSH = """effects:
  brush:
    sentence: a brush drags at the object
    looks_like: A force against the velocity.
    remedy: Take the brush away.
    parameters:
      c: {unit: N s/m, prior_std: 5, typical: 1, description: drag coefficient}
    wrench: {axes: world, force: -c*v}
"""

path = Path(tempfile.mkdtemp()) / "brush.yaml"
path.write_text(BRUSH)
(brush,) = load_effects(path)
print(check_effect(brush))
made = generate_at_whitened_rms(3, {"viscous_drag": 3.0}, ScenarioOptions(duration=6.0))
print(td.estimate(Recording(made.streams, "synthetic"), [brush]))
