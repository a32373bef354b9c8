"""The same object again: how are two recordings combined, and does it notice another object?

    python examples/13_remember_an_object.py

Prints the mass from the first recording, from both together, and what differs beyond chance when
another object is held instead.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import Scenario, ScenarioOptions
from tactile_dynamics_ros.synthetic.recordings import record

box, other, swap = (Scenario.draw(seed, ScenarioOptions(duration=5.0)) for seed in (1, 2, 3))
memory = None
for scenario in (box, replace(other, body=box.body), swap):
    recording = Recording(record(scenario, (), None).streams, "synthetic")
    found = td.estimate(recording, prior=memory)
    body, std = found.found.inertia, found.found.parameter_std
    print(f"mass {body.mass:.5f} ± {std[0]:.5f} kg; changed: {found.changed or 'nothing'}")
    memory = memory or found.save(Path(tempfile.mkdtemp()) / "box.yaml")
