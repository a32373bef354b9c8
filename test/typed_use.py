"""The public interface as a type checker sees it; `./dev lint` checks this file."""

from pathlib import Path
from typing import assert_type

import tactile_dynamics_ros as td

held: td.Recording = td.read("run.mcap", model="held")
pushed: td.PushedRecording = td.read(Path("push.mcap"), model="pushed")
assert_type(td.read("run.mcap"), td.Recording | td.PushedRecording | td.JointRecording)

assert_type(td.check(held), td.Check)
assert_type(td.check(pushed), td.PushedCheck)
assert_type(td.check("run.mcap"), td.Check | td.PushedCheck | td.JointCheck)

estimate = td.estimate(held, "viscous_drag", prior="box.yaml")
assert_type(estimate, td.Estimate)
assert_type(estimate.found.inertia.mass, float)
assert_type(td.estimate(pushed, ["support_tilt"]), td.EstimateOfPushes)
found = td.estimate(Path("run.mcap"))
assert_type(found, td.Estimate | td.EstimateOfPushes | td.EstimateOfJoints)
assert_type(td.estimate("run.mcap").report(Path("out")), Path)

assert_type(td.compare("run.mcap").adequate, bool)
assert_type(td.diagnose("run.mcap").effect, str | None)
assert_type(td.explain("run.mcap", "force_bias").effects, tuple[str, ...])
assert_type(td.shape("cloud.ply"), td.Shape)
assert_type(td.read_wrist("run.mcap"), td.Recording)
