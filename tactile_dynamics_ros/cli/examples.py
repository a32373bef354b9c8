"""What a person types: at least one command for every verb, shown by its --help."""

from __future__ import annotations

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": (
        "demo",
        "demo --object mug --seed 3 --view",
        "demo --hidden random --seed 11",
        "demo --planar --object 121",
    ),
    "run": ("run inertial_estimator --ros-args -r __ns:=/left",),
    "sim": ("sim --object box_0 --hidden viscous_drag",),
    "up": ("up --simulate", "up --without friction_probe,vision_tracker"),
    "echo": ("echo /inertial_estimator/status --count 1",),
    "call": ("call /model_check/diagnose",),
    "set": ("set inertial_estimator effects [viscous_drag]",),
    "probe": ("probe --reference 0.78",),
    "record": ("record run", "record run --duration 30", "record run --check 20"),
    "estimate": ("estimate run.mcap", "estimate run.mcap --effects force_bias --out report"),
    "compare": ("compare run.mcap --out report",),
    "diagnose": (
        "diagnose run.mcap",
        "diagnose run.mcap second.mcap --out report",
        "diagnose pushes.mcap --model pushed",
    ),
    "explain": ("explain run.mcap --out report",),
    "batch": ("batch diagnose runs/**/*.mcap --out answers",),
    "view": ("view", "view run.mcap", "view --control --port 8090"),
    "check": ("check run.mcap",),
    "effects": ("effects", "effects viscous_drag", "effects --model pushed"),
    "excite": ("excite --object box_0 --out motion.json", "excite run.mcap --out motion.json"),
    "import": (
        "import log.csv --guess",
        "import guess log.csv",
        "import csv log.mapping.yaml run.mcap",
        "import static-poses poses.csv poses.mcap",
        "import kuka-ft-imu run_01 run.mcap",
        "import contactnets-cube-tosses tosses.zip toss.mcap",
        "import biotac-slide slide.csv slide.mcap",
        "import pushes-zhou2016 pushes.zip pushes.mcap",
        "import pushes-mit push.json push.mcap",
        "import goal-pushes-zhou2017 logs.npz push.mcap",
    ),
    "shape": ("shape cloud.ply", "shape first.ply second.ply --align --out surface.ply"),
    "synthetic": (
        "synthetic held run.mcap --effect viscous_drag --seed 3",
        "synthetic pushed pushes.mcap --effect support_tilt --seed 112",
    ),
    "train": (
        "train biotac --units 2000 --out weights.npz",
        "train pushing --kind graph_residual --out weights.npz",
    ),
    "calibrate": ("calibrate presses.mcap",),
    "completion": (
        "completion bash > ~/.local/share/bash-completion/completions/tactile-dynamics",
    ),
    "push": ("push --goal 0.5 0.1 0", "push --from 0.5 -0.2 --to 0.5 0.1 --speed 0.05"),
    "explore": ("explore", "explore --json"),
}
"""Arguments after `tactile-dynamics`, by verb."""


def epilog(words: str) -> str:
    """The end of the --help of a verb, or of a form of it such as `synthetic pushed`."""
    verb = words.partition(" ")[0]
    found = [e for e in EXAMPLES.get(verb, ()) if f"{e} ".startswith(f"{words} ")]
    lines = [f"  tactile-dynamics {example}" for example in found]
    return "\n".join(["examples:", *lines]) if lines else ""
