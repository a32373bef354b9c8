"""Two explanations fit equally well: which motion tells them apart?

    python examples/11_separating_motion.py

Prints the effects that a simulated recording cannot tell apart, and the motion or re-grasp after
which it could: something touches the object, or all fingertips read too much.
"""

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms

scenario = ScenarioOptions(duration=6.0)
made = generate_at_whitened_rms(1, {"unsensed_contact": 2.0}, scenario)
found = td.diagnose(Recording(made.streams, "synthetic")).to_json()
print(found["verdict"], found["group"])
print((found["separating_motion"] or {"description": "none separates them"})["description"])
