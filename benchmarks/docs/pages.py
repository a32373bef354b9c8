"""What README and docs tell to type: blocks of code, and the commands in them, in their order."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
INLINE = "inline"
"""Language of a command that stands within a sentence."""
SHELLS = ("bash", "console", INLINE)
"""Languages of blocks that hold commands for a shell."""
_CODE = re.compile(
    r"^```(?P<language>\w*) ?(?P<name>[\w.]*)\n(?P<text>.*?)^```$"
    r"|(?<!`)`(?P<inline>tactile-dynamics [^`]+)`",
    re.DOTALL | re.MULTILINE,
)
_PATTERN = re.compile(r"\||\.\.|\b[A-Z]{2,}\b")
"""Marks of code in a sentence that shows the form of a command, as `effects NAME` does."""


@dataclass(frozen=True)
class Block:
    """A block of code, or a command within a sentence.

    Attributes:
        page: file.
        line: number of its first line.
        language: as after the fence; INLINE within a sentence.
        name: file that readers write it to, as after the language; may be empty.
        text: what it says.
    """

    page: Path
    line: int
    language: str
    name: str
    text: str


@dataclass(frozen=True)
class Command:
    """A command for a shell.

    Attributes:
        line: number of its line on the page.
        text: without prompt and comment.
    """

    line: int
    text: str


def pages() -> list[Path]:
    """Return README, CONTRIBUTING and all pages of docs."""
    docs = ROOT / "docs"
    folders = [docs, *sorted(path for path in docs.iterdir() if path.is_dir())]
    return [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *(page for folder in folders for page in sorted(folder.glob("*.md"))),
    ]


def blocks(page: Path) -> Iterator[Block]:
    """Yield the blocks of a page, and the whole commands within its sentences."""
    text = page.read_text()
    for found in _CODE.finditer(text):
        line = text.count("\n", 0, found.start()) + 1
        inline = found["inline"]
        if inline is None:
            yield Block(page, line, found["language"], found["name"], found["text"])
        elif len(inline.split()) > 2 and not _PATTERN.search(inline):
            yield Block(page, line, INLINE, "", " ".join(inline.split()))


def commands(block: Block) -> Iterator[Command]:
    """Yield the commands of a block; those of a console have the prompt `$ `."""
    if block.language not in SHELLS:
        return
    first = block.line if block.language == INLINE else block.line + 1
    waiting, begun = "", first
    for number, line in enumerate(block.text.splitlines(), first):
        if block.language == "console":
            if not line.startswith("$ "):
                continue
            line = line[2:]
        begun = begun if waiting else number
        waiting += line.partition(" #")[0].strip()
        if waiting.endswith("\\"):
            waiting = waiting[:-1]
        elif waiting:
            yield Command(begun, waiting.removeprefix(".venv/bin/"))
            waiting = ""
