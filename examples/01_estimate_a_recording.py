"""Estimate mass, centre of mass and inertia of a held object from a recording.

    python examples/01_estimate_a_recording.py RUN.mcap --out out/

RUN is a rosbag2 directory, an .mcap or a .db3 file with /object/pose and, per finger,
/contact/<finger>/force and /contact/<finger>/pose. No recording at hand? This makes one:

    tactile-dynamics synthetic held RUN

The same from the shell: tactile-dynamics estimate RUN
"""

import argparse
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.report.estimates import draw_convergence, settle
from tactile_dynamics_ros.report.style import house_style, to_png


def main(arguments: list[str] | None = None) -> None:
    """Read, estimate, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--out", type=Path, help="folder for a figure of the estimates settling")
    options = parser.parse_args(arguments)

    # Reading drops what cannot be used (NaN, stamps that jump, wrong frames ...) and counts it.
    recording = Recording.from_bag(options.recording)
    print(f"{recording.duration:.1f} s of motion")
    for name, contact in recording.streams.contacts.items():
        grip = np.linalg.norm(contact.force, axis=1)
        print(f"  {name:8s} {len(contact.time)} forces, {grip.min():.2f} to {grip.max():.2f} N")
    for line in recording.problem_lines():
        print(f"  note: {line}")

    # The model: one rigid body, moved by nothing but the contacts and gravity.
    model = estimate(recording)
    found = model.to_estimate()
    body, std = found.inertia, found.parameter_std

    print(f"\nmass            {body.mass:.4f} ± {std[0]:.4f} kg")
    for k, axis in enumerate("xyz"):
        print(f"centre of mass  {axis} {1e3 * body.com[k]:7.3f} ± {1e3 * std[1 + k]:.3f} mm")
    print("inertia about the centre of mass, kg mm^2")
    print(np.array2string(1e6 * body.inertia_com, precision=1, suppress_small=True))

    # Whatever the noise, the result is a body that can exist.
    eigenvalues = np.linalg.eigvalsh(body.pseudo_inertia)
    print(f"smallest eigenvalue of the pseudo-inertia: {eigenvalues[0]:.2e} (positive)")

    # 1 means: nothing is left over but the noise that the sensors state.
    print(f"\nerror in units of the noise: {found.error.whitened_rms:.2f}")
    if found.not_excited:
        print(f"not determined by this motion: {', '.join(found.not_excited)}")

    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        with house_style():
            png = to_png(draw_convergence(settle(model)))
        (options.out / "convergence.png").write_bytes(png)
        print(f"figure: {options.out / 'convergence.png'}")


if __name__ == "__main__":
    main()
