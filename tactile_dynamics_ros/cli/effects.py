"""`tactile-dynamics effects`: the catalogue of effects that models can miss."""

from __future__ import annotations

import json
import textwrap
from argparse import Namespace, _SubParsersAction
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.recordings import add_effect_file, read_effect_files
from tactile_dynamics_ros.core.errors import BadInputError, nearest

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_dynamics_ros.core.effects.registry import CatalogueEntry, EffectRegistry

_WIDTH = 96
"""Characters of a line of text, as in the documentation: it fits a terminal of 100."""
_MODELS = {
    "held": "of an object that a hand holds",
    "friction": "of the friction of a probed surface",
    "pushed": "of an object that is pushed or pulled on a support",
    "joints": "of an arm's joints, by their torques",
}
"""Models that effects belong to, as `--model` of the other verbs has them."""
_QUANTITY_NOTE = """\
Vectors have components: v_x. Without suffix they are in the axes of the wrench; v_x_world and
v_x_body say otherwise. A contact is named, as in grip_thumb, f_x_thumb, or left out in wrenches
`at: contacts`, which are summed over all contacts."""
"""What is said below the table of quantities."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("effects")
    parser.add_argument("name", metavar="NAME", nargs="?", help="only this effect, at length")
    parser.add_argument(
        "--model", choices=(*_MODELS, "all"), default="all", help="only the effects of this model"
    )
    add_effect_file(parser)
    parser.add_argument(
        "--quantities", action="store_true", help="what formulas in a yaml file can name instead"
    )
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Print the catalogue, one effect, or the quantities of formulas."""
    read_effect_files(args)
    if args.quantities:
        return _print_quantities(args.json)
    models = list(_MODELS) if args.model == "all" else [args.model]
    entries = [entry for model in models for entry in _entries(model, args.name)]
    if not entries:
        raise BadInputError(_unknown(args.name, models))
    if args.json:
        print(json.dumps({"effects": [entry.to_json() for entry in entries]}))
        return 0
    for model in models:
        own = [_describe(entry, bool(args.name)) for entry in entries if entry.model == model]
        if own:
            print(f"Effects {_MODELS[model]} (--model {model})\n")
            print("\n\n".join(own) + "\n")
    return 0


def _entries(model: str, name: str | None) -> list[CatalogueEntry]:
    """Return the effects of a model, or the one of that name if it has it."""
    from tactile_dynamics_ros.core.effects.registry import HELD, describe_effect
    from tactile_dynamics_ros.core.friction.effects import FRICTION, describe_friction_effect
    from tactile_dynamics_ros.core.joints.effects import JOINTS, describe_joint_effect
    from tactile_dynamics_ros.core.planar.effects.registry import PUSHED, describe_pushed_effect

    registries: dict[str, EffectRegistry[Any]] = {
        registry.model: registry for registry in (HELD, FRICTION, PUSHED, JOINTS)
    }
    known = registries[model].names()
    labels = known if name is None else [name] * (name.partition(":")[0] in known)
    describe: dict[str, Callable[[str], CatalogueEntry]] = {
        "held": lambda label: describe_effect(HELD.create(label)),
        "friction": describe_friction_effect,
        "pushed": describe_pushed_effect,
        "joints": describe_joint_effect,
    }
    return [describe[model](label) for label in labels]


def _unknown(name: str, models: list[str]) -> str:
    """Return what is wrong with a name that no model has."""
    known = [entry.name for model in models for entry in _entries(model, None)]
    return f"effect '{name}' is unknown: expected one of {', '.join(known)}" + nearest(name, known)


def _describe(entry: CatalogueEntry, at_length: bool) -> str:
    """Return an entry for people."""
    from tactile_dynamics_ros.core.effects.registry import group_parameters

    rows = group_parameters(entry.parameters)
    parameters = "; ".join(f"{symbols} [{unit or 1}] {text}" for symbols, unit, text in rows)
    facts = [
        ("formula", entry.formula),
        ("parameters", parameters + (" (for every finger)" if entry.per_finger else "")),
        ("looks like", entry.looks_like),
        ("remedy", entry.remedy),
    ]
    if at_length:
        paragraphs = entry.meaning.split("\n\n")
        facts[1:1] = [("" if k else "meaning", part) for k, part in enumerate(paragraphs)]
        facts += [("in verdicts", entry.sentence), ("readings", ", ".join(entry.readings))]
    lines = [f"{entry.name}  ({entry.family})"]
    for title, text in facts:
        head = f"  {title:11s} "
        lines += textwrap.wrap(text, _WIDTH, initial_indent=head, subsequent_indent=" " * len(head))
    return "\n".join(lines)


def _print_quantities(as_json: bool) -> int:
    """Print what formulas can name."""
    from tactile_dynamics_ros.core.effects.formula.expression import FUNCTIONS
    from tactile_dynamics_ros.core.effects.formula.quantities import (
        CONTACT_SCALARS,
        CONTACT_VECTORS,
        SCALARS,
        VECTORS,
    )

    tables = {
        "scalars": SCALARS,
        "vectors": VECTORS,
        "contact_scalars": CONTACT_SCALARS,
        "contact_vectors": CONTACT_VECTORS,
    }
    if as_json:
        parts = {
            title: {name: {"unit": unit, "description": text} for name, (unit, text) in t.items()}
            for title, t in tables.items()
        }
        print(json.dumps({**parts, "functions": list(FUNCTIONS)}))
        return 0
    for title, table in tables.items():
        print(title.replace("contact_", "of a contact: "))
        for name, (unit, text) in table.items():
            print(f"  {name:10s} {unit:8s} {text}")
    print(f"functions\n  {', '.join(FUNCTIONS)}\n{_QUANTITY_NOTE}")
    return 0
