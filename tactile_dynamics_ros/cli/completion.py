"""`tactile-dynamics completion SHELL`: a script that completes verbs, options, choices, effects."""

from __future__ import annotations

import argparse
from argparse import Namespace, _SubParsersAction
from collections.abc import Iterator
from typing import Any

_BASH = """_tactile_dynamics() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} verb=${{COMP_WORDS[1]}} words
    if ((COMP_CWORD == 1)); then
        COMPREPLY=($(compgen -W '{verbs}' -- "$current"))
        return
    fi
    if [[ ${{COMP_WORDS[COMP_CWORD - 1]}} == --effect* && $current != -* ]]; then
        [[ ${{COMP_WORDS[COMP_CWORD - 1]}} == --effect-file ]] && return
        COMPREPLY=($(compgen -W '{effects}' -- "$current"))
        return
    fi
    case $verb in
{cases}
    esac
    COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _tactile_dynamics tactile-dynamics
"""

_ZSH = "autoload -U +X bashcompinit && bashcompinit\n"
"""zsh reads scripts of bash after this."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("completion", help="print a script that completes in a shell")
    parser.add_argument("shell", choices=("bash", "zsh"))
    parser.set_defaults(run=lambda args: run(args, verbs))


def run(args: Namespace, verbs: _SubParsersAction[Any]) -> int:
    """Print the script."""
    cases = [
        f"        {name}) words='{' '.join(sorted(set(_words(parser))))}' ;;"
        for name, parser in sorted(verbs.choices.items())
    ]
    script = _BASH.format(
        verbs=" ".join(sorted(verbs.choices)),
        effects=" ".join(_effect_names()),
        cases="\n".join(cases),
    )
    print((_ZSH if args.shell == "zsh" else "") + script, end="")
    return 0


def _words(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield what may follow a verb: options, choices, and the same of what it is divided into."""
    for action in parser._actions:
        yield from (option for option in action.option_strings if option.startswith("--"))
        if isinstance(action, _SubParsersAction):
            for name, part in action.choices.items():
                yield name
                yield from _words(part)
        elif action.choices is not None:
            yield from map(str, action.choices)
        elif action.dest == "node":
            from tactile_dynamics_ros.cli.bringup import node_names

            yield from node_names()
        elif action.dest == "name":
            yield from _effect_names()


def _effect_names() -> list[str]:
    """Return the names of the effects of all models."""
    from tactile_dynamics_ros.core.effects import EFFECT_NAMES
    from tactile_dynamics_ros.core.planar.effects.registry import PUSHED_EFFECT_NAMES

    return sorted({*EFFECT_NAMES, *PUSHED_EFFECT_NAMES})
