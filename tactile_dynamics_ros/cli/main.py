"""Entry point of `tactile-dynamics`: finds the verb, runs it, turns errors into exit codes."""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from collections.abc import Collection, Sequence
from contextlib import nullcontext
from typing import Any

from tactile_dynamics_ros.cli.progress import write_plain_where_needed
from tactile_dynamics_ros.cli.verbs import VERBS, epilog
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError, nearest
from tactile_dynamics_ros.core.files import reason_of
from tactile_dynamics_ros.stopping import Stopped, StopRequest
from tactile_dynamics_ros.version import __version__

_NEGATIVE = re.compile(r"-\.?\d")
"""Beginning of negative numbers, also of several with commas (-1,2): they are values of options.
argparse itself takes all but a single one for options."""


NODE_VERBS = ("run", "sim", "up")
"""Verbs that end with 0 on Ctrl-C or SIGTERM, as nodes do, also while they load."""


class _Parser(argparse.ArgumentParser):
    """An argument parser that reports a usage error in one line, with the nearest known name."""

    def __init__(self, *args: Any, **keywords: Any) -> None:
        super().__init__(*args, **keywords)
        self._negative_number_matcher = _NEGATIVE

    def error(self, message: str) -> None:  # type: ignore[override]
        """Raise what argparse would print and exit for."""
        raise BadInputError(f"{self.prog}: {message} (see {self.prog} --help)")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            raise argparse.ArgumentError(
                action,
                f"'{value}' is unknown{nearest(str(value), known)}; expected {_listed(known)}",
            )

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Return the arguments; an option that no verb has is refused with the nearest."""
        found, left = self.parse_known_args(args, namespace)
        if left:
            verbs = next(a for a in self._actions if isinstance(a, argparse._SubParsersAction))
            parser = verbs.choices[found.verb]
            known = list(parser._option_string_actions)
            parser.error(f"'{left[0]}' is unknown{nearest(left[0].partition('=')[0], known)}")
        return found


def _listed(known: Sequence[str]) -> str:
    return known[0] if len(known) == 1 else f"one of {', '.join(known)}"


class _Verbs(argparse._SubParsersAction):  # type: ignore[type-arg]
    """Parsers of verbs, each with its line of `VERBS`."""

    def add_parser(self, name: str, **keywords: Any) -> argparse.ArgumentParser:
        """Return the parser of a verb."""
        return super().add_parser(name, help=VERBS[name].help, **keywords)


def build_parser(wanted: Collection[str] = tuple(VERBS)) -> argparse.ArgumentParser:
    """Return the parser of all verbs; only the modules of those that are wanted are imported.

    A module has `add_parser(verbs)`, and every parser sets `run=callable(args) -> int`, where heavy
    imports belong.
    """
    parser = _Parser(
        prog="tactile-dynamics",
        description="Estimate forces, pose and inertia of a held object, live and from recordings.",
    )
    parser.add_argument("--version", action="version", version=__version__)
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True, action=_Verbs)
    loaded = {VERBS[name].module for name in wanted}
    for name, verb in VERBS.items():
        if name in verbs.choices:
            continue
        if verb.module in loaded:
            importlib.import_module(f"tactile_dynamics_ros.cli.{verb.module}").add_parser(verbs)
        else:
            verbs.add_parser(name)
    for name in wanted:
        form = verbs.choices[name]
        _add_examples(form, name)
        if "--json" not in form._option_string_actions:
            form.add_argument("--json", action="store_true", help="print only JSON on stdout")
    return parser


def _add_examples(parser: argparse.ArgumentParser, words: str) -> None:
    """Add examples to the help of a verb, and of the forms that it has."""
    parser.epilog = parser.epilog or epilog(words)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, form in action._name_parser_map.items():
                _add_examples(form, f"{words} {name}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return its exit code (0 done, 2 bad input, 3 not identifiable)."""
    write_plain_where_needed()
    words = sys.argv[1:] if arguments is None else [*arguments]
    runs_nodes = words[:1] and words[0] in NODE_VERBS
    try:
        with StopRequest(patience=0.0) if runs_nodes else nullcontext():
            args = build_parser([word for word in words[:1] if word in VERBS]).parse_args(words)
            return int(args.run(args) or 0)
    except Stopped:
        return 0
    except TactileDynamicsError as error:
        return _refused(str(error), error.exit_code)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except OSError as error:
        return _refused(reason_of(error), BadInputError.exit_code)


def _refused(message: str, exit_code: int) -> int:
    """Print in one line why a verb does not go on; return the exit code."""
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return exit_code


if __name__ == "__main__":
    sys.exit(main())
