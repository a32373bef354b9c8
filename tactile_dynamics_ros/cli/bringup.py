"""Which nodes of a robot are started, with which parameters, and when one that died comes back.

`tactile-dynamics up`, the demo and launch/bringup.launch.py share it.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_yaml

RESPAWN_DELAY = 2.0
"""Time from the death of a node to its next start, s: what it held (ports of DDS, devices) is free
again by then, and a node that dies at once takes a small share of a processor."""

MOST_RESPAWNS = 3
RESPAWN_WINDOW = 60.0
"""A node is started again at most `MOST_RESPAWNS` times within so many seconds: a node that was
killed or met one bad message is back after the first; one that needs a fourth has a lasting cause,
which more starts only bury in the log."""

_RUNS_NODE = re.compile(r"^def main\(.*^ +return run_node\(", re.MULTILINE | re.DOTALL)
NAMESPACE = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*")
SWITCH = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


def node_names() -> tuple[str, ...]:
    """Return the executables: all modules of the package `nodes` whose main runs a node."""
    folder = Path(__file__).parents[1] / "nodes"
    texts = {path.stem: path.read_text() for path in sorted(folder.glob("*.py"))}
    return tuple(n for n, text in texts.items() if _RUNS_NODE.search(text))


def read_switch(name: str, text: str) -> bool:
    """Return what a launch argument or option says.

    Raises:
        BadInputError: it says neither true nor false.
    """
    if text.lower() not in SWITCH:
        raise BadInputError(f"{name} '{text}': expected true or false")
    return SWITCH[text.lower()]


def read_names(text: str) -> list[str]:
    """Return the names in "[a, b]", "a,b" or "a b"."""
    return re.findall(r"[^\s,\[\]'\"]+", text)


def read_namespace(text: str) -> str:
    """Return a namespace with its leading slash; empty if none is given.

    Raises:
        BadInputError: it is none.
    """
    if text in ("", "/"):
        return ""
    if not NAMESPACE.fullmatch(text):
        raise BadInputError(f"namespace '{text}': expected letters, digits, _ and /, as in left")
    return "/" + text.lstrip("/")


def configuration_files(config: Path, simulate: bool) -> list[Path]:
    """Return a robot's file and, where that is simulated, `<stem>.simulated.yaml` beside it."""
    beside = config.with_name(f"{config.stem}.simulated.yaml")
    return [config, beside] if simulate and beside.is_file() else [config]


def read_configuration(config: Path, simulate: bool = True) -> dict[str, dict[str, Any]]:
    """Return the parameters of every node that a robot's files list, in their order.

    Args:
        config: yaml file of the robot.
        simulate: whether the robot is simulated; what is known of the simulated one alone is in
            the file beside it, which wins.

    Raises:
        BadInputError: there is no such file, or it lists something that is no node.
    """
    nodes: dict[str, dict[str, Any]] = {}
    for file in configuration_files(config, simulate):
        for name, parameters in _read_file(file).items():
            nodes.setdefault(name, {}).update(parameters)
    if not simulate:
        nodes.pop("robot_sim", None)
    for name, parameters in nodes.items():
        if name != "robot_sim":
            parameters["use_sim_time"] = simulate
    return nodes


def nodes_of(config: Path, simulate: bool = True) -> list[str]:
    """Return the nodes that a robot's files list, in their order."""
    return list(read_configuration(config, simulate))


def _read_file(file: Path) -> dict[str, dict[str, Any]]:
    """Return the parameters, by their names with dots, of every node in one file."""
    content = read_yaml(file, "parameters of nodes in yaml")
    if not isinstance(content, dict):
        raise BadInputError(f"{file}: expected node names with their ros__parameters")
    unknown = [name for name in content if name not in node_names()]
    if unknown:
        raise BadInputError(f"{file}: no node '{unknown[0]}'; known: {', '.join(node_names())}")
    return {name: _parameters(file, name, entry) for name, entry in content.items()}


def _parameters(file: Path, name: str, entry: object) -> dict[str, Any]:
    """Return the parameters of one node's entry."""
    found = entry.get("ros__parameters") if isinstance(entry, dict) else None
    if not isinstance(found, dict) or entry != {"ros__parameters": found}:
        raise BadInputError(f"{file}: {name}: expected ros__parameters with their values")
    return _flatten(found)


def _flatten(parameters: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested parameters by their names with dots."""
    flat: dict[str, Any] = {}
    for key, value in parameters.items():
        if isinstance(value, dict):
            flat |= _flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def write_parameters(
    config: Path, folder: Path, simulate: bool = True, without: Sequence[str] = ()
) -> dict[str, Path]:
    """Write a parameter file for every node to be started, valid in any namespace.

    A file whose keys are names of nodes would only reach nodes of the root namespace.

    Args:
        config: yaml file of the robot.
        folder: where the files go; made if missing, and kept as long as nodes are started.
        simulate: whether the robot is simulated.
        without: nodes that are left out.

    Returns:
        The file of each node, in the order in which they are listed.

    Raises:
        BadInputError: a name is unknown, or nothing remains.
    """
    nodes = read_configuration(config, simulate)
    unknown = [name for name in without if name not in node_names()]
    if unknown:
        raise BadInputError(f"without: no node '{unknown[0]}'; {config} lists {', '.join(nodes)}")
    wanted = {name: value for name, value in nodes.items() if name not in without}
    if not wanted:
        raise BadInputError(f"{config}: nothing to start without {', '.join(without) or 'any'}")
    if simulate and "biotac_force" in wanted:  # another simulation's tare is of other fingertips
        wanted["biotac_force"].setdefault("tare_file", str(folder / "tare.npy"))
    folder.mkdir(parents=True, exist_ok=True)
    return {name: _write_file(folder / f"{name}.yaml", value) for name, value in wanted.items()}


def _write_file(file: Path, parameters: Mapping[str, Any]) -> Path:
    """Write the parameters of one node."""
    document = {"/**": {"ros__parameters": dict(parameters)}} if parameters else {}
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    return file


def require_simulator() -> None:
    """Check that the simulated robot can be started.

    Raises:
        MissingExtraError: pybullet is not installed.
    """
    import tactile_dynamics_ros.sim  # noqa: F401


@dataclass(frozen=True)
class Verdict:
    """Whether a node that died is started again, and the line that says so."""

    again: bool
    sentence: str


class Respawns:
    """Decides which nodes that die are started again."""

    def __init__(self) -> None:
        self._starts: dict[str, deque[float]] = {}

    def note_death(self, name: str, code: int, now: float) -> Verdict:
        """Judge a death.

        Args:
            name: of the node.
            code: exit code, negative for a signal.
            now: s, of any steady clock.
        """
        starts, start = self._starts.setdefault(name, deque()), now + RESPAWN_DELAY
        while starts and start - starts[0] >= RESPAWN_WINDOW:
            starts.popleft()
        if len(starts) < MOST_RESPAWNS:
            starts.append(start)
            return Verdict(
                True, f"{name} ended with {code}; it is started again in {RESPAWN_DELAY:g} s"
            )
        return Verdict(
            False,
            f"{name} ended with {code} after {MOST_RESPAWNS} new starts within "
            f"{RESPAWN_WINDOW:g} s: it is not started again",
        )


def require_hidden_effect(name: str, scene: str) -> None:
    """Refuse a hidden effect that the simulated robot does not have.

    Args:
        name: of the effect; empty for none.
        scene: "hand" or "table".

    Raises:
        BadInputError: there is no such effect.
    """
    from tactile_dynamics_ros.sim import hidden_effects
    from tactile_dynamics_ros.sim.planar import hidden_effects as effects_of_table

    (effects_of_table if scene == "table" else hidden_effects).known_effect(name)


def require_table_object(number: int) -> None:
    """Check that the simulated table has an object.

    Args:
        number: of config/planar_objects.yaml; 0 for a random one.

    Raises:
        BadInputError: there is no such object.
    """
    from tactile_dynamics_ros.sim.objects import planar_object

    if number:
        planar_object(number)


def require_simulated_robot(config: Path) -> None:
    """Check that a robot's files say which robot is simulated.

    Raises:
        BadInputError: they list no robot_sim.
    """
    if "robot_sim" not in read_configuration(config):
        beside = config.with_name(f"{config.stem}.simulated.yaml")
        raise BadInputError(
            f"{config} lists no robot_sim, so that no robot can be simulated; name yours under "
            f"robot_sim in {beside}, as config/panda_gripper.simulated.yaml does"
        )
