"""Write an effect that is not in the catalogue as a Python class, test it, fit it.

    tactile-dynamics synthetic held RUN --effect cross_talk --whitened-rms 3
    python examples/33_write_your_own_effect.py RUN

The effect: fingertip sensors share a cable, so each also reads a part of the others' forces. From
the shell, this file is all that is needed:

    tactile-dynamics estimate RUN --effect-file examples/33_write_your_own_effect.py \
        --effects sensor_crosstalk
"""

import argparse
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.effects import EffectParameter, LinearEffect, register_effect
from tactile_dynamics_ros.core.effects.check import check_effect
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.recording import Recording


@register_effect
class SensorCrosstalk(LinearEffect):
    """Measured z_i = f_i + sum_j k_ij f_j, i reads a part of j, both in their own sensor axes.

    For small k the true force is f_i = z_i - sum_j k_ij z_j. An effect is what has to be ADDED to
    the measured wrench, here -k_ij times the wrench of z_j acting at contact i.
    """

    name = "sensor_crosstalk"
    family = "sensor"
    formula = "measured f_i = true f_i + sum_j k_ij true f_j (sensor axes)"
    looks_like = "A residual at one finger in proportion to the force of another."
    sentence = "the fingertip sensors read parts of each other's forces"
    remedy = "Separate or shield the sensor cables, or add the crosstalk to the model."
    external = False  # an error of what sensors read, not a wrench on the object

    def parameters(self, samples):
        """Return one dimensionless share for every ordered pair of contacts."""
        return tuple(
            EffectParameter(f"{reader}_reads_{source}", "", 0.3, f"share of {source} in {reader}")
            for reader in samples.contact_names
            for source in samples.contact_names
            if reader != source
        )

    def jacobian(self, samples, inertia, theta):
        """Return the wrench of each pair per unit share, (N, 6, pairs); nothing depends on theta.

        A linear effect gives these columns and no more: wrench, screening and first guess of a fit
        follow. Everything is vectorised over the N samples.
        """
        axes, contacts = samples.contact_rotation, range(len(samples.contact_names))
        own_axes = np.einsum("ncij,nci->ncj", axes, samples.contact_force)
        columns = []
        for reader in contacts:
            touching = samples.in_contact[:, reader, None]
            for source in contacts:
                if source == reader:
                    continue
                read = np.einsum("nij,nj->ni", axes[:, reader], own_axes[:, source]) * touching
                torque = np.cross(samples.contact_point[:, reader], read)
                columns.append(-np.concatenate([torque, read], axis=1))
        return np.stack(columns, axis=2)


def main(arguments: list[str] | None = None) -> None:
    """Test the class, fit without and with it, print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    options = parser.parse_args(arguments)

    # Shapes, units, derivatives against finite differences, independence of the choice of axes:
    # a wrong sign or a forgotten frame shows here and not in a wrong estimate.
    print(check_effect(SensorCrosstalk()))

    recording = Recording.from_bag(options.recording)
    alone = estimate(recording).to_estimate()
    print(f"rigid body alone: {alone.error.whitened_rms:.2f} times the noise")
    fitted = estimate(recording, [SensorCrosstalk()]).to_estimate()
    print(f"with crosstalk:   {fitted.error.whitened_rms:.2f} times the noise")
    print(f"mass {alone.inertia.mass:.4f} -> {fitted.inertia.mass:.4f} kg\n")

    found = fitted.effects["sensor_crosstalk"]
    names = tuple(recording.streams.contacts)
    print("share of the column's finger in the row's reading, in %")
    print(" " * 10 + "".join(f"{name:>14s}" for name in names))
    for reader in names:
        cells = []
        for source in names:
            key = f"{reader}_reads_{source}"
            same = reader == source
            cells.append(
                "-" if same else f"{100 * found.value[key]:.1f} ± {100 * found.std[key]:.1f}"
            )
        print(f"{reader:10s}" + "".join(f"{cell:>14s}" for cell in cells))


if __name__ == "__main__":
    main()
