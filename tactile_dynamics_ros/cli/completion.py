"""`tactile-dynamics completion SHELL`: a script that completes verbs, options, choices, effects."""

from __future__ import annotations

import argparse
from argparse import Namespace, _SubParsersAction
from typing import Any

SHELLS = ("bash", "zsh")

_WORDS = {
    "bash": '_tactile_dynamics_{}() {{ compgen -W "{}" -- "$1"; }}',
    "zsh": "_tactile_dynamics_{}() {{ compadd -- {} }}",
}
"""Functions of a shell that complete names which depend on what is installed."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("completion")
    parser.add_argument("shell", choices=SHELLS)
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Print the script."""
    import shtab

    from tactile_dynamics_ros.cli.bringup import node_names
    from tactile_dynamics_ros.cli.main import build_parser
    from tactile_dynamics_ros.core.effects import EFFECT_NAMES
    from tactile_dynamics_ros.core.planar.effects.registry import PUSHED_EFFECT_NAMES

    parser = build_parser()
    _mark_names(parser)
    names = {"effects": {*EFFECT_NAMES, *PUSHED_EFFECT_NAMES}, "nodes": node_names()}
    functions = [
        _WORDS[args.shell].format(kind, " ".join(sorted(found))) for kind, found in names.items()
    ]
    print(shtab.complete(parser, args.shell, preamble={args.shell: "\n".join(functions)}))
    return 0


def _mark_names(parser: argparse.ArgumentParser) -> None:
    """Let arguments that name an effect or a node be completed by these names."""
    for action in parser._actions:
        if isinstance(action, _SubParsersAction):
            action.choices = action._name_parser_map  # `import` takes files in their place too
            for form in action.choices.values():
                _mark_names(form)
        kind = {"node": "nodes", "name": "effects", "effect": "effects", "effects": "effects"}
        if action.choices is None and action.dest in kind:
            function = f"_tactile_dynamics_{kind[action.dest]}"
            action.complete = dict.fromkeys(SHELLS, function)  # type: ignore[attr-defined]
