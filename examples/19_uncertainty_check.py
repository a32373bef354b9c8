"""Are the stated standard deviations right?

    python examples/19_uncertainty_check.py [N]

Prints, over N simulated recordings with known truth (6), how many true masses and centres of mass
lie within the stated 90 % intervals. With N = 50 the share is within a few percent of 90 %.
"""

import sys

import numpy as np

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate


def main(arguments: list[str]) -> None:
    """Estimate many, count, print."""
    inside = []
    for seed in range(int(*arguments or [6])):
        made = generate(100 + seed, scenario=ScenarioOptions(duration=4.0))
        found = td.estimate(Recording(made.streams, f"seed {seed}")).found
        body, true = found.inertia, made.scenario.body
        wrong = np.array([body.mass - true.mass, *(body.com - true.com)])
        inside.append(np.abs(wrong) < 1.645 * found.parameter_std[:4])
    print(f"{np.sum(inside)} of {np.size(inside)} true values lie within their 90 % interval")


if __name__ == "__main__":
    main(sys.argv[1:])
