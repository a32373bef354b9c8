"""The sensor carries a gripper too: what does the load weigh without it?

    python examples/12_take_out_the_gripper.py

Prints what the sensors carry, and the load alone: a gripper of 0.2 kg, known by its URDF, is taken
out. A file of `td.estimate(empty).save(..)` takes the URDF's place if the gripper was recorded.
"""

import tempfile
from pathlib import Path

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate

GRIPPER = """<robot name="gripper"><link name="hand"><inertial>
<origin xyz="0 0 0.005"/><mass value="0.2"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>
</inertial></link></robot>"""

streams = generate(1, scenario=ScenarioOptions(duration=6.0)).streams
recording = Recording(streams, "synthetic")
urdf = Path(tempfile.mkdtemp()) / "gripper.urdf"
urdf.write_text(GRIPPER)
print("with the gripper", td.estimate(recording), sep="\n")
print("the load alone", td.estimate(recording, tool=urdf), sep="\n")
