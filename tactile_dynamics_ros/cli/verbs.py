"""The verbs of the command: module, one line, and what a person types."""

from __future__ import annotations

from typing import NamedTuple


class Verb(NamedTuple):
    """What is known of a verb before its module is loaded.

    Attributes:
        module: of this package, with `add_parser(verbs)`; it may add several verbs.
        help: one line.
        examples: arguments after `tactile-dynamics`, at least one, shown by its --help.
    """

    module: str
    help: str
    examples: tuple[str, ...]


VERBS: dict[str, Verb] = {
    "demo": Verb(
        "demo",
        "a simulated hand lifts an unknown object; its inertia appears live",
        (
            "demo",
            "demo --object mug --seed 3 --view",
            "demo --hidden random --seed 11",
            "demo --planar --object 121",
            "demo --weigh",
        ),
    ),
    "run": Verb(
        "live",
        "run one node, as `ros2 run tactile_dynamics_ros NODE`",
        ("run inertial_estimator --ros-args -r __ns:=/left",),
    ),
    "sim": Verb(
        "live",
        "run the simulated robot alone",
        ("sim --object box_0 --hidden viscous_drag",),
    ),
    "up": Verb(
        "live",
        "start all nodes of a robot and keep them running",
        ("up --simulate", "up --without friction_probe,vision_tracker"),
    ),
    "echo": Verb(
        "topics",
        "print messages of a topic, as `ros2 topic echo`",
        ("echo /inertial_estimator/status --count 1",),
    ),
    "call": Verb(
        "topics",
        "call a service without arguments (std_srvs/Trigger)",
        ("call /model_check/diagnose",),
    ),
    "send-goal": Verb(
        "goals",
        "send a goal to an action, as `ros2 action send_goal`; Ctrl-C cancels it",
        (
            "send-goal /model_check/diagnose --feedback",
            "send-goal /explorer/explore '{change: true}'",
        ),
    ),
    "set": Verb(
        "topics",
        "change a parameter of a running node",
        ("set inertial_estimator effects [viscous_drag]",),
    ),
    "probe": Verb(
        "probe",
        "let a finger measure the friction coefficient",
        ("probe --reference 0.78",),
    ),
    "push": Verb(
        "push",
        "push an object to a pose, or along a straight line",
        ("push --goal 0.5 0.1 0 --explore 0.003", "push --from 0.5 -0.2 --to 0.5 0.1 --speed 0.05"),
    ),
    "explore": Verb(
        "explore",
        "push an object on a table where a push tells most, until its parameters are known",
        ("explore", "explore --json"),
    ),
    "weigh": Verb(
        "weigh",
        "an arm weighs its tool and its load, and sets its controller's payload",
        ("weigh --dry-run", "weigh --apply", "weigh --tool none"),
    ),
    "record": Verb(
        "record",
        "record live topics as rosbag2 (MCAP)",
        ("record run", "record run --duration 30", "record run --check 20"),
    ),
    "check": Verb(
        "check",
        "rates, gaps, clocks, units and excitation of a recording, and what to record as well",
        ("check run.mcap",),
    ),
    "estimate": Verb(
        "estimate",
        "mass, centre of mass and inertia from a recording, with uncertainty",
        (
            "estimate run.mcap",
            "estimate run.mcap --effects force_bias --out report",
            "estimate loaded.mcap --without empty.mcap",
        ),
    ),
    "compare": Verb(
        "discrepancy",
        "how far the model is from a recording, and where it fails",
        ("compare run.mcap --out report",),
    ),
    "diagnose": Verb(
        "discrepancy",
        "which effect is missing from the model of a recording",
        (
            "diagnose run.mcap",
            "diagnose run.mcap second.mcap --out report",
            "diagnose pushes.mcap --model pushed",
            "diagnose run.mcap --learn law.yaml",
        ),
    ),
    "explain": Verb(
        "discrepancy",
        "add missing effects one by one and watch the error fall",
        ("explain run.mcap --out report",),
    ),
    "batch": Verb(
        "batch",
        "run one verb on many recordings; writes a table and a page of reports; can resume",
        ("batch diagnose runs/**/*.mcap --out answers",),
    ),
    "view": Verb(
        "view",
        "live page in the browser; with BAG, of a recording",
        ("view", "view run.mcap", "view --control --port 8090"),
    ),
    "effects": Verb(
        "effects",
        "the catalogue of effects: formula, parameters, what it looks like, remedy",
        ("effects", "effects viscous_drag", "effects --model pushed"),
    ),
    "excite": Verb(
        "excite",
        "design the motion that reveals most about a held object or an arm, within limits",
        (
            "excite --object box_0 --out motion.json",
            "excite run.mcap --out motion.json",
            "excite --urdf arm.urdf --out motion.json",
        ),
    ),
    "import": Verb(
        "import_",
        "turn tables, bags or a known data set into a recording; FILE --guess proposes how",
        (
            "import log.csv --guess",
            "import guess log.csv",
            "import csv log.mapping.yaml run.mcap",
            "import static-poses poses.csv poses.mcap",
            "import kuka-ft-imu kuka_ft_imu/1-baseline run.mcap",
            "import contactnets-cube-tosses tosses.zip toss.mcap",
            "import biotac-slide slide.csv slide.mcap",
            "import pushes-zhou2016 pushes.zip pushes.mcap",
            "import pushes-mit push.json push.mcap",
            "import goal-pushes-zhou2017 logs.npz push.mcap",
        ),
    ),
    "shape": Verb(
        "shape",
        "parts, size and pose of an object on a table from point clouds, and the next view",
        ("shape cloud.ply", "shape first.ply second.ply --align --out surface.ply"),
    ),
    "synthetic": Verb(
        "synthetic",
        "simulate a recording; the true values go into a file next to it",
        (
            "synthetic held run.mcap --effect viscous_drag --seed 3",
            "synthetic pushed pushes.mcap --effect support_tilt --seed 112",
        ),
    ),
    "train": Verb(
        "train",
        "retrain shipped networks on simulated data",
        (
            "train biotac --units 2000 --out weights.npz",
            "train pushing --kind graph_residual --out weights.npz",
        ),
    ),
    "calibrate": Verb(
        "calibrate",
        "calibrate the fingertips of one hand: gains from presses on a known force, and drift",
        ("calibrate presses.mcap",),
    ),
    "completion": Verb(
        "completion",
        "print a script that completes in a shell",
        ("completion bash > ~/.local/share/bash-completion/completions/tactile-dynamics",),
    ),
}
"""All verbs, in the order of --help. To add one: a line here, and its module."""


def epilog(words: str) -> str:
    """The end of the --help of a verb, or of a form of it such as `synthetic pushed`."""
    verb = words.partition(" ")[0]
    found = [e for e in VERBS[verb].examples if f"{e} ".startswith(f"{words} ")]
    lines = [f"  tactile-dynamics {example}" for example in found]
    return "\n".join(["examples:", *lines]) if lines else ""
