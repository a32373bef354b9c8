"""What each effect of a joint leaves in the torques of an arm on one motion."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tactile_dynamics_ros.core.joints.estimate import fit
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.report.style import BLUE, ORANGE, house_style, new_figure
from tactile_dynamics_ros.synthetic.joints import JointOptions, generate

_SEED, _DURATION = 7, 20.0
_ALONG_ANGLE = ("torque_ripple", "link_cable", "base_tilt")
"""Effects that follow the angle of a joint rather than its speed."""


def draw_joint_signature(name: str) -> Figure:
    """Draw the torque that links and plain friction leave of the joint that shows it most.

    Left over time, right over the speed or the angle of the joint.
    """
    urdf = load_robot("allegro_iiwa").urdf
    made = generate(urdf, _SEED, {name: 1.5}, JointOptions(duration=_DURATION, effort_noise=0.02))
    model = fit(made.streams)
    left = model.residuals()
    joint = int(np.argmax(np.mean(left.white**2, axis=0)))
    q, dq, _ = model.samples.middle
    along, words = (q, "angle, rad") if name in _ALONG_ANGLE else (dq, "speed, rad/s")
    with house_style():
        figure = new_figure(2.2)
        time, relation = figure.subplots(1, 2, sharey=True, width_ratios=(2, 1))
        time.plot(left.time, left.physical[:, joint], color=BLUE, linewidth=0.8)
        time.set_xlabel("time, s")
        time.set_ylabel(f"missing torque of joint {joint + 1}, {left.units[joint]}")
        relation.plot(along[:, joint], left.physical[:, joint], ".", color=ORANGE, markersize=2)
        relation.set_xlabel(words)
    return figure
