"""Which tables of docs/benchmarks.md are older than what they measure; `all` makes them anew.

./dev bench stamps [--write]: list sections, the version of their rows and what changed since.
./dev bench all [--only SECTION ..]: run the commands of sections that are stale, one by one, and
keep what they print in out/bench with version and machine; what is there is not run again, so that
it goes on where Ctrl-C ended it. --release also puts what was printed, with the version, into the
page of docs/lab; --dry-run says what would run, and which stamps are old.
./dev bench stamps --stamp SECTION: after its rows were entered, stamp it with that version.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "benchmarks.md"
RUNS = ROOT / "out" / "bench"
STAMP = re.compile(r"as of `([0-9a-f]{7,40})`(?: on ([^,)]+))?(?:, (\d+) changes? since)?")
OLD = 20
"""Changes to what is measured that a stamp may be behind at a release. Fewer ask for hours of runs
at each release; with more, some rows describe another program."""
CORE = "tactile_dynamics_ros/core"
MEASURED = {
    "Inertia": (f"{CORE}/inertia", f"{CORE}/numerics", "benchmarks/inertia"),
    "In the simulated hand": (f"{CORE}/tactile", f"{CORE}/inertia", "tactile_dynamics_ros/sim"),
    "Which effect is missing": (f"{CORE}/discrepancy", f"{CORE}/effects", "benchmarks/effects"),
    "Recordings that others made": (f"{CORE}/discrepancy", f"{CORE}/inertia"),
    "Live": (f"{CORE}/inertia/live", "tactile_dynamics_ros/nodes", "tactile_dynamics_ros/ros"),
    "Tracking": (f"{CORE}/tracking", "benchmarks/tracking"),
    "Friction": (f"{CORE}/friction", f"{CORE}/tactile", "benchmarks/friction"),
    "Conventions": (f"{CORE}/inertia/conventions", f"{CORE}/discrepancy"),
    "Objects on a table": (f"{CORE}/shape", "benchmarks/shape"),
    "What a model of pushes lacks": (f"{CORE}/planar", f"{CORE}/discrepancy", "benchmarks/pushed"),
    "Learnt models of pushing": (f"{CORE}/planar/network", f"{CORE}/planar/filter"),
    "Around an estimate": ("tactile_dynamics_ros/api", f"{CORE}/inertia", "benchmarks/watch.py"),
}
"""What the numbers of each section depend on most; a change anywhere in it makes them stale."""


@dataclass(frozen=True)
class Section:
    """A section of the page.

    Attributes:
        title: as in the page. text: of it. record: its page in docs, as `lab/inertia.md`.
        commit: with which its rows came. machine: if stated.
        commands: that make it, without arguments that the page leaves to the record.
    """

    title: str
    text: str
    record: str
    commit: str
    machine: str
    commands: tuple[str, ...]

    def changes(self) -> int | None:
        """Commits since that changed what is measured; None if git does not know."""
        command = ["git", "rev-list", "--count", f"{self.commit}..HEAD", "--"]
        done = subprocess.run(
            [*command, *MEASURED[self.title]], cwd=ROOT, capture_output=True, text=True
        )
        return None if done.returncode else int(done.stdout)


def read_sections(page: str) -> list[Section]:
    """Sections of the page in their order.

    Raises:
        ValueError: one has no stamp.
    """
    found = []
    for part in page.split("\n## ")[1:]:
        title, _, text = part.partition("\n")
        stamp = STAMP.search(text)
        if stamp is None:
            raise ValueError(f"{title}: no stamp such as (as of `a1b2c3d`)")
        head = text.partition("|")[0]
        commands = tuple(re.findall(r"`((?:\./dev bench|python -m benchmarks)[^`]*)`", head))
        record = re.search(r"\]\((lab/\w+\.md)", head)
        page_of = record[1] if record else ""
        found.append(Section(title, text, page_of, stamp[1], stamp[2] or "", commands))
    return found


def mark(page: str) -> str:
    """Return the page with what has changed since each stamp."""
    for section in read_sections(page):
        count = section.changes()
        if count is None:
            continue
        machine = f" on {section.machine}" if section.machine else ""
        since = f", {count} change{'s' * (count > 1)} since" if count else ""
        text = STAMP.sub(f"as of `{section.commit}`{machine}{since}", section.text, count=1)
        page = page.replace(section.text, text)
    return page


def restamp(page: str, title: str, commit: str, machine: str) -> str:
    """Return the page with the stamp of one section replaced."""
    (section,) = (one for one in read_sections(page) if one.title == title)
    text = STAMP.sub(f"as of `{commit}` on {machine}", section.text, count=1)
    return page.replace(section.text, text)


def run_section(section: Section) -> bool:
    """Run the commands of a section that this version has not run; return whether all succeeded."""
    folder = _folder(section.title)
    folder.mkdir(parents=True, exist_ok=True)
    version = {"commit": _git("rev-parse", "--short", "HEAD"), "machine": machine_name()}
    kept = _run_of(section.title)
    done = kept["commands"] if kept and kept["commit"] == version["commit"] else []
    for k, command in enumerate(section.commands):
        if command in done:
            continue
        words = shlex.split(command.replace("./dev bench", f"{sys.executable} benchmarks/run.py"))
        if words[0] == "python":
            words[0] = sys.executable
        print(f"{section.title}: {command} ...", file=sys.stderr, flush=True)
        with (folder / f"{k}.txt").open("w") as out:
            if subprocess.run(words, cwd=ROOT, stdout=out).returncode:
                print(f"error: {command} failed; {folder / f'{k}.txt'}", file=sys.stderr)
                return False
        done = [*done, command]
        (folder / "run.json").write_text(json.dumps(version | {"commands": done}))
    return True


def kept_run(section: Section) -> dict[str, Any] | None:
    """Version and machine of a section's finished run; None if there is none."""
    kept = _run_of(section.title)
    return kept if kept and set(section.commands) <= set(kept["commands"]) else None


def _run_of(title: str) -> dict[str, Any] | None:
    file = _folder(title) / "run.json"
    return json.loads(file.read_text()) if file.exists() else None


def _folder(title: str) -> Path:
    return RUNS / title.lower().replace(" ", "_")


def enter(record: str, section: Section, kept: dict[str, Any]) -> str:
    """Return a page of docs/lab with what a section's commands printed, in place of what was there.

    Args:
        record: text of the page.
        section: whose figures.
        kept: version and machine of the run.
    """
    heading = f"## {section.title}: as printed at the release"
    before, _, after = record.partition(f"{heading}\n")
    rest = after.partition("\n## ")
    lines = [heading, f"`{kept['commit']}` on {kept['machine']}, by `./dev bench all --release`."]
    for k, command in enumerate(section.commands):
        printed = (_folder(section.title) / f"{k}.txt").read_text().rstrip()
        lines += ["", f"`{command}`", "", "```text", printed, "```"]
    return before.rstrip() + "\n\n" + "\n".join(lines) + "\n" + "".join(rest[1:])


def machine_name() -> str:
    """Processor and number of cores."""
    cores = len(re.findall(r"^processor", _read(Path("/proc/cpuinfo")), re.MULTILINE)) or "?"
    model = re.search(r"model name\s*: (.*)", _read(Path("/proc/cpuinfo")))
    return f"{cores} x {model[1] if model else platform.processor() or platform.machine()}"


def _read(path: Path) -> str:
    return path.read_text() if path.exists() else ""


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def run_all(sections: Sequence[Section], only: Sequence[str], release: bool = False) -> int:
    """Run what is stale, or what is named, unless this version has been run already.

    Args:
        sections: of the page.
        only: titles; all if empty.
        release: whether pages of docs/lab get what is printed.
    """
    failed = 0
    for section in sections:
        if not (section.title in only if only else section.changes() != 0):
            continue
        kept = kept_run(section)
        if kept is None or kept["commit"] != _git("rev-parse", "--short", "HEAD"):
            if not run_section(section):
                failed += 1
                continue
            kept = kept_run(section)
        if release and kept and section.record:
            page = PAGE.parent / section.record
            page.write_text(enter(page.read_text(), section, kept))
            print(f"{page}: enter its rows in {PAGE.name}, then ./dev bench stamps --stamp "
                  f"'{section.title}'")  # fmt: skip
    return 1 if failed else 0


def foresee(sections: Sequence[Section], only: Sequence[str]) -> Iterator[str]:
    """Yield what `all` would run, and a warning of each stamp that is old.

    Args:
        sections: of the page.
        only: titles; all if empty.
    """
    for section in sections:
        count = section.changes()
        if section.title in only if only else count != 0:
            yield from (f"{section.title}: {command}" for command in section.commands)
        if count is not None and count > OLD:
            yield f"warning: {section.title}: stamp {section.commit} is {count} changes old"


def main(run: bool = False) -> int:
    """List the sections, mark or stamp them; or run them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    sections = read_sections(PAGE.read_text())
    titles = [section.title for section in sections]
    if run:
        parser.add_argument("--only", nargs="+", default=[], choices=titles, metavar="SECTION")
        parser.add_argument("--release", action="store_true", help="put it into docs/lab too")
        parser.add_argument("--dry-run", action="store_true", help="say what would run, and stop")
        args = parser.parse_args()
        if args.dry_run:
            print("\n".join(foresee(sections, args.only)))
            return 0
        return run_all(sections, args.only, args.release)
    parser.add_argument("--write", action="store_true", help="mark stale sections in the page")
    parser.add_argument("--stamp", choices=titles, metavar="SECTION", help="with its last run")
    args = parser.parse_args()
    if args.stamp:
        kept = kept_run(next(one for one in sections if one.title == args.stamp))
        if kept is None:
            print(f"error: no finished run: ./dev bench all --only '{args.stamp}'", file=sys.stderr)
            return 2
        PAGE.write_text(restamp(PAGE.read_text(), args.stamp, kept["commit"], kept["machine"]))
    for section in sections:
        count = section.changes()
        since = "not known here" if count is None else f"{count} changes" if count else "fresh"
        print(f"{section.title:32s} {section.commit:10s} {since}")
    if args.write:
        PAGE.write_text(mark(PAGE.read_text()))
    return 0
