"""The rooms of the package: what each is for and what it may import; the only statement of it.

`python test/unit/rooms.py` writes the table of docs/architecture.md anew.
"""

import ast
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = "tactile_dynamics_ros"
PAGE = REPOSITORY / "docs" / "architecture.md"
BEGIN, END = "<!-- rooms: begin -->", "<!-- rooms: end -->"


@dataclass(frozen=True)
class Room:
    """A folder (or module) of the package.

    Attributes:
        about: in a few words.
        imports: other rooms; errors, configuration, share and stopping are for all.
        libraries: heavy ones that only some rooms may use.
    """

    about: str
    imports: tuple[str, ...] = ()
    libraries: tuple[str, ...] = ()


COMMON = ("", "core", "share", "stopping")
HEAVY = ("torch", "gtsam", "pybullet", "pybullet_data", "rclpy", "viser")
_INERTIA = "core/inertia/"

ROOMS = {
    "core/rigid_body": Room("rotations, inertial parameters, Newton-Euler"),
    "core/streams": Room(
        "what was measured, with stamps; order and clock of what comes", ("core/rigid_body",)
    ),
    "core/robot": Room(
        "arm, hand and fingertips as data, kinematics, what errors of joints do",
        ("core/rigid_body",),
    ),
    "core/shape": Room(
        "surfaces of objects, their regions and hulls, skin of a fingertip",
        ("core/rigid_body",),
    ),
    "core/numerics": Room(
        "least squares, whitening, local polynomials, noise, outliers, intervals of scalars",
        ("core/rigid_body", "core/streams"),
    ),
    "core/contact": Room(
        "contacts in the world, samples on a common grid",
        ("core/rigid_body", "core/robot", "core/shape"),
    ),
    "core/tactile": Room(
        "BioTac counts to force",
        ("core/contact", "core/rigid_body", "core/robot", "core/shape"),
        ("torch",),
    ),
    "core/tracking": Room(
        "pose of the object", ("core/rigid_body", "core/robot", "core/shape", "core/streams")
    ),
    "core/effects": Room(
        "the catalogue of effects that a model may lack",
        ("core/contact", "core/numerics", "core/rigid_body", "core/streams"),
    ),
    "core/discrepancy": Room(
        "which effect is missing; knows nothing of hands or objects", ("core/numerics",)
    ),
    "core/weighing": Room(
        "an arm that turns what it carries about: its links' clearance, the motion that tells most",
        ("core/rigid_body", "core/robot", _INERTIA + "excitation"),
    ),
    "core/manipulation": Room(
        "grasp, lift, excite: measured state to joint targets", ("core/rigid_body", "core/robot")
    ),
    "core/friction": Room(
        "probing with one finger, slip, coefficients, what Coulomb lacks",
        ("core/discrepancy", "core/effects", "core/numerics", "core/rigid_body", "core/robot")
        + ("core/shape", "core/tactile"),
    ),
    "core/joints": Room(
        "arms by the torques of their joints: links, friction, payload, and what is missing",
        ("core/discrepancy", "core/effects", "core/numerics", "core/rigid_body", "core/robot")
        + ("core/streams", "core/weighing"),
    ),
    "core/planar": Room(
        "streams of objects that are pushed and pulled on a support", ("core/planar/mechanics",)
    ),
    "core/planar/mechanics": Room(
        "motion of links on a support with Coulomb friction, under a tip or a grip"
    ),
    "core/planar/filter": Room(
        "live belief about a pushed object: a dual filter over any model that predicts pushes",
        ("core/planar", "core/planar/effects", "core/planar/mechanics", "core/planar/memory")
        + ("core/planar/properties",),
    ),
    "core/planar/actions": Room(
        "pushes and pulls as paths of a gripper; what they would tell",
        ("core/planar", "core/planar/linked", "core/planar/mechanics", "core/rigid_body"),
    ),
    "core/planar/control": Room(
        "the next pushes that bring an object to a pose, in closed loop",
        ("core/numerics", "core/planar/actions", "core/planar/linked", "core/planar/mechanics"),
    ),
    "core/planar/effects": Room(
        "what the model of a pushed object may lack, by name",
        ("core/effects", "core/numerics", "core/planar/mechanics"),
    ),
    "core/planar/network": Room(
        "the graph network that predicts pushes, alone or beside the mechanics, and its training",
        ("core/planar/filter", "core/planar/mechanics"),
        ("torch",),
    ),
    "core/planar/properties": Room(
        "the door to estimates of pushed objects; mass, friction and centre on a latent motion",
        (
            "core/numerics",
            "core/planar",
            "core/planar/effects",
            "core/planar/linked",
            "core/planar/mechanics",
        )
        + ("core/planar/sparse",),
    ),
    "core/planar/memory": Room(
        "a pushed object together with what earlier recordings told of it",
        ("core/planar", "core/planar/properties"),
    ),
    "core/planar/linked": Room(
        "two parts beside each other: outlines, relative motion, what pushes let expect",
        ("core/planar", "core/planar/mechanics"),
    ),
    "core/planar/diagnosis": Room(
        "a pushed object as the diagnosis questions it: white innovations of its poses",
        (
            "core/discrepancy",
            "core/discrepancy/model",
            "core/effects",
            "core/planar",
            "core/planar/effects",
            "core/planar/linked",
            "core/planar/mechanics",
            "core/planar/properties",
        ),
    ),
    "core/planar/sparse": Room(
        "friction force and centre of mass from poses before and after pushes",
        ("core/planar", "core/planar/mechanics"),
    ),
    _INERTIA + "residuals": Room(
        "Newton-Euler residuals of a recording and their noise",
        ("core/contact", "core/effects", "core/numerics", "core/rigid_body", "core/streams"),
    ),
    _INERTIA + "batch": Room(
        "fits to a whole recording, and what they return",
        ("core/contact", "core/discrepancy", "core/effects", _INERTIA + "residuals")
        + ("core/numerics", "core/rigid_body", "core/streams", "core/tracking"),
    ),
    _INERTIA + "conventions": Room(
        "other readings of a recording: units, signs, axes and orders that people mistake",
        ("core/contact", "core/discrepancy", _INERTIA + "batch", _INERTIA + "residuals")
        + ("core/numerics", "core/rigid_body", "core/streams"),
    ),
    _INERTIA + "excitation": Room(
        "motions that tell most",
        ("core/contact", _INERTIA + "batch", _INERTIA + "residuals", "core/manipulation")
        + ("core/rigid_body", "core/robot", "core/streams"),
    ),
    _INERTIA + "diagnosis": Room(
        "the held object as a model that the search for effects questions",
        ("core/contact", "core/discrepancy", "core/effects", _INERTIA + "batch")
        + (_INERTIA + "conventions", _INERTIA + "excitation", _INERTIA + "residuals")
        + ("core/numerics", "core/rigid_body", "core/streams"),
    ),
    "core/inertia": Room(
        "`estimate.py`, the door to an estimate, and what the shape of a body tells of it",
        ("core/effects", _INERTIA + "batch", _INERTIA + "diagnosis", "core/numerics")
        + ("core/rigid_body", "core/shape", "core/streams"),
    ),
    _INERTIA + "compensation": Room(
        "the wrench of the world on what is carried",
        ("core/contact", "core/effects", "core/rigid_body"),
    ),
    _INERTIA + "live": Room(
        "estimates while measurements come",
        ("core/contact", "core/effects", "core/inertia", _INERTIA + "batch")
        + (_INERTIA + "residuals", "core/numerics", "core/rigid_body", "core/shape")
        + ("core/streams",),
        ("gtsam",),
    ),
    "recording": Room(
        "rosbag2, arrays and foreign formats to streams and back",
        (
            "core/friction",
            "core/joints",
            "core/numerics",
            "core/planar",
            "core/planar/mechanics",
            "core/rigid_body",
            "core/robot",
            "core/shape",
            "core/streams",
        )
        + ("core/tactile", "core/tracking"),
    ),
    "synthetic": Room(
        "recordings with known truth from closed forms; knows no effect of the catalogue",
        ("core/planar", "core/planar/filter", "core/planar/mechanics", "core/planar/network")
        + ("core/streams", "recording"),
    ),
    "sim": Room(
        "the PyBullet stand-in for hand, arm, sensors and object, with hidden effects",
        ("core/manipulation", "core/planar", "core/planar/actions", "core/planar/network")
        + ("core/rigid_body", "core/robot", "core/shape", "core/tactile")
        + ("core/tracking",),
        ("pybullet", "pybullet_data"),
    ),
    "report": Room(
        "figures and pages",
        ("core/contact", "core/discrepancy", "core/effects", _INERTIA + "batch")
        + ("core/planar", "core/planar/effects", "core/planar/mechanics", "core/rigid_body")
        + ("core/streams", "recording"),
    ),
    "export": Room(
        "estimates in the formats of simulators and robots",
        (_INERTIA + "batch", "core/rigid_body", "core/shape"),
    ),
    "api": Room(
        "the verbs of the command as functions, with results for notebooks",
        ("core/discrepancy", "core/effects", "core/friction", "core/inertia", "core/joints")
        + (_INERTIA + "batch", _INERTIA + "diagnosis", _INERTIA + "excitation")
        + (_INERTIA + "residuals", "core/rigid_body", "core/shape")
        + ("core/planar", "core/planar/actions", "core/planar/diagnosis", "core/planar/linked")
        + ("core/planar/mechanics", "core/planar/memory", "core/planar/properties")
        + ("export", "recording", "report"),
    ),
    "ros": Room(
        "what nodes share: shell, wire, conversions, parameters, diagnostics",
        (
            "core/contact",
            "core/effects",
            "core/friction",
            "core/weighing",
            _INERTIA + "batch",
            _INERTIA + "compensation",
            _INERTIA + "diagnosis",
            _INERTIA + "live",
            "core/discrepancy",
            "core/joints",
        )
        + (
            "core/planar",
            "core/planar/actions",
            "core/planar/control",
            "core/planar/diagnosis",
            "core/planar/effects",
            "core/planar/filter",
            "core/planar/mechanics",
            "core/planar/memory",
            "core/planar/properties",
            "core/rigid_body",
            "core/robot",
            "core/shape",
            "core/streams",
        )
        + ("core/tracking",)
        + ("recording",),
        ("rclpy",),
    ),
    "view": Room(
        "the live page in the browser, of topics or of a recording",
        ("api", _INERTIA + "live", "core/planar", "core/planar/properties", "core/rigid_body")
        + ("core/robot", "core/streams")
        + ("recording", "ros"),
        ("rclpy", "viser"),
    ),
    "nodes": Room(
        "one file per executable: parameters, subscriptions, publishers",
        ("core/contact", "core/discrepancy", "core/friction", _INERTIA + "diagnosis")
        + (_INERTIA + "compensation",)
        + ("core/inertia", _INERTIA + "live", "core/manipulation", "core/rigid_body")
        + ("core/robot", "core/shape", "core/weighing", "recording")
        + ("core/planar/actions", "core/planar/control", "core/planar/filter")
        + ("core/planar/mechanics", "core/planar/network", "core/planar/properties")
        + ("core/joints", "core/streams", "core/tactile", "core/tracking", "ros", "sim"),
        ("rclpy",),
    ),
    "cli": Room(
        "the command",
        ("api",)
        + ("core/discrepancy", "core/effects", "core/friction", "core/inertia", "core/joints")
        + (_INERTIA + "batch", _INERTIA + "conventions", _INERTIA + "diagnosis")
        + (_INERTIA + "excitation",)
        + (
            _INERTIA + "residuals",
            "core/manipulation",
            "core/planar/actions",
            "core/planar",
            "core/planar/effects",
            "core/planar/memory",
            "core/planar/network",
            "core/planar/properties",
            "core/rigid_body",
            "core/robot",
            "core/shape",
            "core/tactile",
            "core/weighing",
        )
        + ("recording", "report", "ros", "sim", "synthetic", "view"),
        ("rclpy", "torch"),
    ),
}


def imported_names(text: str) -> set[str]:
    """Return the dotted names that a module imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def room_of(parts: Iterable[str]) -> str:
    """Return the room of a path within the package, given in parts: the deepest that has a name."""
    path = [*parts]
    for count in range(len(path), 0, -1):
        name = "/".join(path[:count])
        if name in ROOMS:
            return name
    return (
        "core" if path[:1] == ["core"] else path[0] if len(path) == 1 and path[0] in COMMON else ""
    )


def breaches(file: Path, text: str) -> list[tuple[str, str]]:
    """Return (room, imported room or library) for each import that a module's room may not do.

    Args:
        file: path within the package.
        text: its source.
    """
    own = room_of(file.with_suffix("").parts)
    room = ROOMS.get(own, Room(""))
    found = set()
    for name in imported_names(text):
        first, *rest = name.split(".")
        if first in HEAVY and first not in room.libraries:
            found.add((own, first))
        if first == PACKAGE:
            other = room_of(rest)
            if other not in (own, *COMMON, *room.imports):
                found.add((own, other))
    return sorted(found)


def table() -> str:
    """Return the rooms as a table in Markdown."""
    lines = ["| room | what | may import |", "|---|---|---|"]
    for name, room in ROOMS.items():
        allowed = [f"`{other}`" for other in room.imports] + [*room.libraries]
        lines.append(f"| `{name}` | {room.about} | {', '.join(allowed)} |")
    return "\n".join(lines)


def page() -> str:
    """Return docs/architecture.md with the table of today."""
    text = PAGE.read_text()
    head, tail = text.split(BEGIN)[0], text.split(END)[1]
    return f"{head}{BEGIN}\n{table()}\n{END}{tail}"


if __name__ == "__main__":
    PAGE.write_text(page())
