"""My log has gaps, NaN and repeated stamps: what is done with them?

    python examples/25_faulty_data.py

Prints each kind of fault that was found in a damaged table and how often, and that the estimate
still holds.
"""

import numpy as np

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate

made = generate(1, scenario=ScenarioOptions(duration=6.0))
pose, contacts = made.streams.pose, {}
for name, contact in made.streams.contacts.items():
    contacts[name] = {
        "time": contact.time,
        "force": contact.force.copy(),
        "force_std": 0.03,
        "position": np.array(
            [np.interp(contact.time, contact.pose_time, p) for p in contact.position.T]
        ).T,
    }
contacts["index"]["force"][50:60] = np.nan
moved = {"time": pose.time.copy(), "position": pose.position, "rotation": pose.rotation}
moved["time"][200] = moved["time"][199]
recording = Recording.from_arrays(contacts, moved)
print(*recording.problem_lines(), sep="\n")
print(td.estimate(recording))
