"""How should the robot move the object so that the inertia becomes known?

    python examples/15_exciting_motion.py

Prints the expected standard deviations before and after a motion that is designed for a box in the
hand, within the limits of the arm and the grip. A robot follows the table of --out:
tactile-dynamics excite --object box_2 --out motion.json
"""

from tactile_dynamics_ros.core.inertia.excitation import DesignConfig
from tactile_dynamics_ros.core.inertia.excitation.plan import plan_first_excitation
from tactile_dynamics_ros.core.manipulation.grasp_planner import GraspSite
from tactile_dynamics_ros.share import object_file

site = GraspSite.from_file(object_file("box_2"))
plan = plan_first_excitation(site, DesignConfig(duration=5.0), mass=0.3)
for name, (now, after, unit) in plan.deviations().items():
    print(f"{name:12s} {now:9.3g} -> {after:9.3g} {unit}")
print(f"at most {plan.grip_usage:.0%} of the friction cones is used")
