"""`tactile-dynamics import`: measurements in other forms to a recording."""

from __future__ import annotations

import argparse
import json
import sys
from argparse import SUPPRESS, ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Container, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.recordings import NEW_RECORDING
from tactile_dynamics_ros.cli.verbs import VERBS
from tactile_dynamics_ros.core.errors import BadInputError, refuse_existing
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.options import file_to_write, path_to_write
from tactile_dynamics_ros.recording.bag_options import add_bag_arguments, add_say
from tactile_dynamics_ros.recording.importers import IMPORTERS, Importer
from tactile_dynamics_ros.recording.importers.bag import bag_answers

if TYPE_CHECKING:
    from tactile_dynamics_ros.recording.importers.guess import Guess

GUESS = "guess"
"""Word of the form that looks for the meaning of columns; a file in its place means the same."""


class _FormOrFile(argparse._SubParsersAction):  # type: ignore[type-arg]
    """Takes a file where the name of a form is expected: `import FILE --guess`."""

    def __init__(self, *args: Any, **keywords: Any) -> None:
        super().__init__(*args, **keywords)
        self.choices = _NamesAndFiles(self._name_parser_map)  # type: ignore[assignment]

    def __call__(
        self,
        parser: ArgumentParser,
        namespace: Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Go on with the form, or with `guess` and the file."""
        words = list(values)
        if words[0] not in self._name_parser_map:
            words.insert(0, GUESS)
            namespace.without_form = True
        super().__call__(parser, namespace, words, option_string)


class _NamesAndFiles(dict[str, ArgumentParser]):
    """Names of forms; what looks like a path is one too."""

    def __init__(self, names: Container[str]) -> None:
        super().__init__()
        self._names = names

    def __contains__(self, word: object) -> bool:
        """Whether a word is a form or a file."""
        text = str(word)
        return word in self._names or "." in text or "/" in text or Path(text).exists()

    def __iter__(self) -> Any:
        """Names of the forms, for messages."""
        return iter(self._names)  # type: ignore[call-overload]


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb with one word per importer."""
    parser = verbs.add_parser("import", description=VERBS["import"].help)
    forms = parser.add_subparsers(dest="form", metavar="FORM", required=True, action=_FormOrFile)
    for importer in IMPORTERS:
        form = forms.add_parser(importer.name, help=importer.summary, description=importer.summary)
        form.add_argument("source", metavar="SOURCE", help=importer.source_help)
        form.add_argument("out", type=path_to_write, metavar="OUT", help=NEW_RECORDING)
        _add_json(form)
        importer.add_arguments(form)
        form.set_defaults(run=run, importer=importer)
    _add_guess(
        forms.add_parser(
            GUESS, help="find out what the columns of FILE mean (same as FILE --guess)"
        )
    )


def _add_json(form: ArgumentParser) -> None:
    form.add_argument(
        "--json", action="store_true", default=SUPPRESS, help="print only JSON on stdout"
    )


def _add_guess(form: ArgumentParser) -> None:
    """Add the arguments of `import FILE --guess`."""
    form.add_argument(
        "files", metavar="FILE", nargs="+", help="one table or bag, or several tables of one clock"
    )
    form.add_argument("--guess", action="store_true", help="propose a mapping and write it as yaml")
    add_bag_arguments(form)
    add_say(form)
    form.add_argument(
        "--out",
        type=file_to_write,
        metavar="YAML",
        help="where the mapping goes (default: FILE.mapping.yaml)",
    )
    _add_json(form)
    form.set_defaults(run=run_guess)


def run(args: Namespace) -> int:
    """Read the source, write the recording and print what is in it."""
    importer: Importer = args.importer
    recording = importer.read(Path(args.source), args)
    path = recording.to_bag(args.out)
    streams = recording.streams
    summary = {
        "recording": str(path),
        "duration_s": recording.duration,
        "poses": sum(len(stream.time) for stream in _poses(streams)),
        "imu_samples": len(streams.imu.time) if getattr(streams, "imu", None) else 0,
        "contacts": {name: len(contact.time) for name, contact in streams.contacts.items()},
        "problems": recording.problems,
    }
    print(json.dumps(summary) if args.json else _describe(summary, recording.problem_lines()))
    return 0


def _poses(streams: Any) -> Sequence[Any]:
    """Return the pose streams of a held object, or of the links of a pushed one."""
    if hasattr(streams, "links"):
        return tuple(streams.links)
    return () if streams.pose is None else (streams.pose,)


def run_guess(args: Namespace) -> int:
    """Propose a mapping, show what was understood, and write it.

    Raises:
        BadInputError: something has to be asked, or the file is there already.
    """
    from tactile_dynamics_ros.recording.importers.guess import Answers, guess_tables

    paths = [Path(file) for file in args.files]
    _require_question(args, paths)
    out = Path(args.out) if args.out else paths[0].with_suffix(".mapping.yaml")
    refuse_existing(out)
    guess = guess_tables(paths, Answers(bag_answers(args)))
    if guess.question:
        _print_understood(guess)
        raise BadInputError(f"{paths[0]}: {guess.question}")
    return _write_guess(guess, paths, out, args.json)


def _write_guess(guess: Guess, paths: Sequence[Path], out: Path, as_json: bool) -> int:
    """Write the mapping and show what it makes of the tables."""
    import yaml

    from tactile_dynamics_ros.recording.importers.csv_mapping import read_mapping
    from tactile_dynamics_ros.recording.importers.guess.description import (
        describe_first_row,
        describe_understood,
    )

    mapping = _placed(guess.mapping, paths[0].parent, out.parent)
    recording = read_mapping(mapping, out.parent, str(out))
    text = yaml.safe_dump(mapping, sort_keys=False, default_flow_style=None, width=100)
    with written_whole(out) as part:
        part.write_text(f"# read from {', '.join(p.name for p in paths)}; check it\n{text}")
    first = describe_first_row(recording)
    if as_json:
        understood = [{"what": label, "as": text} for label, text in guess.understood]
        document = {"mapping": str(out), "understood": understood, "first_row": first}
        print(json.dumps({**document, "problems": recording.problem_lines()}))
        return 0
    print(describe_understood([*guess.understood, ("first row", first)]))
    for line in recording.problem_lines():
        print(f"note: {line}")
    print(f"wrote {out}; if it is right: tactile-dynamics import csv {out} OUT.mcap")
    return 0


def _placed(mapping: dict[str, Any], tables: Path, beside: Path) -> dict[str, Any]:
    """Return the mapping with paths from the folder in which it will lie."""
    if tables.resolve() == beside.resolve():
        return mapping

    def moved(part: Any) -> Any:
        if not isinstance(part, dict):
            return part
        found = {key: moved(value) for key, value in part.items()}
        if isinstance(part.get("file"), str):
            found["file"] = str((tables / part["file"]).resolve())
        return found

    return dict(moved(mapping))


def _print_understood(guess: Guess) -> None:
    """Show on stderr what was understood before the question."""
    from tactile_dynamics_ros.recording.importers.guess.description import describe_understood

    if guess.understood:
        print(describe_understood(guess.understood), file=sys.stderr)


def _require_question(args: Namespace, paths: Sequence[Path]) -> None:
    """Check that a guess was asked for.

    Raises:
        BadInputError: a file was named as if it were a form.
    """
    if args.guess or not getattr(args, "without_form", False):
        return
    forms = ", ".join(importer.name for importer in IMPORTERS)
    raise BadInputError(
        f"import {paths[0]}: add --guess to find out what its columns mean, or name a form first "
        f"({forms})"
    )


def _describe(summary: dict[str, Any], problems: list[str]) -> str:
    """Return the summary for people."""
    contacts = ", ".join(f"{name} ({count})" for name, count in summary["contacts"].items())
    lines = [
        f"{summary['recording']}: {summary['duration_s']:.2f} s, {summary['poses']} poses, "
        f"{summary['imu_samples']} IMU samples, contacts: {contacts or 'none'}"
    ]
    return "\n".join([*lines, *(f"note: {line}" for line in problems)])
