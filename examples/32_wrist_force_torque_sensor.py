"""Estimate a robot's payload from its wrist force/torque sensor, whatever the sensor's bias.

    tactile-dynamics import kuka-ft-imu ../shared/data/kuka_ft_imu/1-baseline payload.mcap
    python examples/32_wrist_force_torque_sensor.py payload.mcap

    tactile-dynamics import my_arm.csv --guess            # the same with a log of your own arm
    tactile-dynamics import static-poses poses.csv payload.mcap    # or with a table of static poses

A wrist sensor is one contact that carries torque. Such sensors read several newtons without any
load; an arm that turns its wrist tells this bias from the weight, because the bias stays with the
sensor while gravity does not. So the bias is part of the model (effect `force_bias`) and is
estimated together with the load; where one sensor is all that is recorded, it always is.
"""

import argparse
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.effects import create_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.recording import Recording


def describe(found: InertialEstimate) -> None:
    """Print mass, centre of mass and error."""
    std = found.parameter_std
    com, com_std = 1e3 * found.inertia.com, 1e3 * std[1:4]
    places = ", ".join(f"{c:.1f} ± {s:.1f}" for c, s in zip(com, com_std, strict=True))
    print("\nthe load, with the sensor's bias in the model")
    print(f"  mass            {found.inertia.mass:.4f} ± {std[0]:.4f} kg")
    print(f"  centre of mass  {places} mm")
    print(f"  error           {found.error.whitened_rms:.2f} times the stated noise")


def main(arguments: list[str] | None = None) -> None:
    """Estimate the load and the sensor's bias."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    options = parser.parse_args(arguments)
    recording = Recording.from_bag(options.recording)
    streams = recording.streams

    wrists = [c for c in streams.contacts.values() if c.carries_torque]
    if not wrists:
        raise BadInputError(
            f"{recording.source}: no contact carries torque; expected a wrist sensor"
        )
    for wrist in wrists:
        mean = np.linalg.norm(wrist.force.mean(axis=0))
        print(f"{wrist.name}: {len(wrist.time)} wrenches, mean force {mean:.2f} N")
    if streams.imu is not None:
        print(f"IMU: {len(streams.imu.time)} samples; accelerations are measured, not derived")

    found = estimate(streams, [create_effect("force_bias")]).to_estimate()
    describe(found)
    print("\nthe bias, in the object's axes, as a wrench on the object")
    bias = found.effects["force_bias"]
    for name, value in bias.value.items():
        print(f"  {name:14s} {value:8.3f} ± {bias.std[name]:.3f} {bias.unit[name]}")
    if found.not_excited:
        print(f"\nnot determined by this motion: {', '.join(found.not_excited)}")
        print("(a wrist that only turns slowly shows mass and centre of mass, not the inertia)")


if __name__ == "__main__":
    main()
