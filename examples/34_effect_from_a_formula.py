"""Write an effect as a formula in yaml, let derivatives and units be handled, fit it.

    tactile-dynamics synthetic held RUN --effect dry_rubbing --whitened-rms 3
    python examples/34_effect_from_a_formula.py RUN --out rubbing.yaml

From the shell, with the file that this writes:

    tactile-dynamics effects dry_friction --effect-file rubbing.yaml
    tactile-dynamics estimate RUN --effect-file rubbing.yaml --effects dry_friction

`tactile-dynamics effects --quantities` lists what a formula can name; docs/effects.md has the rest.
"""

import argparse
import tempfile
from pathlib import Path

from tactile_dynamics_ros.core.effects import create_effect
from tactile_dynamics_ros.core.effects.check import check_effect
from tactile_dynamics_ros.core.effects.formula import load_effects
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.recording import Recording

FORMULA = """\
effects:
  dry_friction:
    sentence: something dry rubs on the object
    looks_like: A force of constant size against the direction of motion.
    remedy: Find what rubs, or keep it in the model.
    parameters:
      F: {unit: N, prior_std: 5, typical: 0.2, description: size of the friction}
    constants:
      slow: {value: 0.005, unit: m/s}   # below this speed the friction fades
    wrench:
      axes: world
      force: -F*v/sqrt(dot(v, v) + slow^2)
"""


def main(arguments: list[str] | None = None) -> None:
    """Write the file, read it, fit without it, with it, and with what looks similar."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--out", type=Path, help="where to write the yaml file")
    options = parser.parse_args(arguments)
    folder = Path(tempfile.mkdtemp())
    path = options.out or folder / "rubbing.yaml"
    path.write_text(FORMULA)

    # Reading makes the effect known by its name, like those of the catalogue.
    (effect,) = load_effects(path)
    print(f"{effect.name}: {effect.formula}")
    print(check_effect(effect))

    # A formula whose units do not fit is refused, with the place and both units.
    wrong = folder / "wrong.yaml"
    wrong.write_text(FORMULA.replace("unit: N,", "unit: N s/m,"))
    try:
        load_effects(wrong)
    except BadInputError as error:
        print(f"refused: {error}")
    load_effects(path)

    # Candidates compete on the recording; the right one leaves only noise.
    recording = Recording.from_bag(options.recording)
    print("\nerror in units of the noise")
    for name in ("", "viscous_drag", "quadratic_drag", "dry_friction"):
        effects = [create_effect(name)] if name else []
        found = estimate(recording, effects).to_estimate()
        print(f"  {name or 'rigid body alone':18s} {found.error.whitened_rms:.2f}")

    friction = found.effects["dry_friction"]
    value, std = friction.value["F"], friction.std["F"]
    print(f"\nfriction {value:.3f} ± {std:.3f} {friction.unit['F']}")
    print(f"mass {found.inertia.mass:.4f} ± {found.parameter_std[0]:.4f} kg")


if __name__ == "__main__":
    main()
