"""Add effects to the rigid body one at a time and watch the error fall.

    tactile-dynamics synthetic held RUN --effect viscous_drag --whitened-rms 3
    python examples/05_watch_the_error_fall.py RUN --out out/

The slow and simple way: every effect is added in turn and everything is fitted anew; the one that
lowers the error most stays; repeat. `tactile-dynamics explain` does it with statistical tests on
held-out data, and says when two effects cannot be told apart.
"""

import argparse
from pathlib import Path

from tactile_dynamics_ros.core.effects import create_effect, registered_names
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.report.discrepancies import draw_error_steps
from tactile_dynamics_ros.report.style import house_style, to_png

GOOD_ENOUGH = 1.05
LEAST_GAIN = 0.03


def error_with(recording: Recording, names: list[str]) -> float:
    """Return the whitened RMS of a rigid body with these effects."""
    effects = [create_effect(name) for name in names]
    return estimate(recording, effects).to_estimate().error.whitened_rms


def main(arguments: list[str] | None = None) -> None:
    """Add the best effect until nothing helps."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--try", dest="names", default="", help="effects to try; default: all")
    parser.add_argument("--steps", type=int, default=2, help="most effects to add")
    parser.add_argument("--out", type=Path, help="folder for a figure")
    options = parser.parse_args(arguments)
    recording = Recording.from_bag(options.recording)
    names = options.names.split(",") if options.names else list(registered_names())

    steps = [{"added": None, "error": error_with(recording, [])}]
    print(f"rigid body alone: {steps[0]['error']:.3f} times the noise")
    added: list[str] = []
    while len(added) < options.steps and steps[-1]["error"] > GOOD_ENOUGH:
        errors = {n: error_with(recording, [*added, n]) for n in names if n not in added}
        ranking = sorted(errors, key=errors.__getitem__)
        for name in ranking[:5]:
            print(f"    + {name:20s} {errors[name]:.3f}")
        best = ranking[0]
        if errors[best] > (1.0 - LEAST_GAIN) * steps[-1]["error"]:
            print("nothing in the list helps any more")
            break
        added.append(best)
        steps.append({"added": best, "error": errors[best]})
        print(f"added {best}: {errors[best]:.3f} times the noise")

    if added:
        effects = [create_effect(name) for name in added]
        found = estimate(recording, effects).to_estimate()
        print(f"\nmass {found.inertia.mass:.4f} ± {found.parameter_std[0]:.4f} kg, and")
        for name, effect in found.effects.items():
            for key, value in effect.value.items():
                print(f"  {name} {key} = {value:.4g} ± {effect.std[key]:.2g} {effect.unit[key]}")
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        with house_style():
            (options.out / "steps.png").write_bytes(to_png(draw_error_steps(steps)))
        print(f"figure: {options.out / 'steps.png'}")


if __name__ == "__main__":
    main()
