"""Pictures of the short examples: what they print, as its `draw` shows it.

python -m docs.example_pictures [NUMBER ..]
"""

from __future__ import annotations

import builtins
import runpy
import sys
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import patch

from docs.effect_pages import few_colours

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "figures" / "examples"


def draw(path: Path) -> bool:
    """Run an example and keep the picture of the last result that it prints.

    Args:
        path: of the example.

    Returns:
        Whether it prints one that can be drawn.
    """
    drawn = []

    def take(*printed: object, **_: object) -> None:
        drawn.extend(one for one in printed if hasattr(one, "draw"))

    with patch.object(builtins, "print", take), patch.object(sys, "argv", [path.name]):
        runpy.run_path(str(path), run_name="__main__")
    if drawn:
        (PICTURES / f"{path.name[:2]}.png").write_bytes(few_colours(drawn[-1].plot()))
    return bool(drawn)


def main(numbers: Sequence[str]) -> int:
    """Draw the examples of these numbers; without any, all short ones."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for path in sorted((ROOT / "examples").glob("[0-2][0-9]_*.py")):
        if not numbers or path.name[:2] in numbers:
            print(path.name, "drawn" if draw(path) else "prints nothing to draw", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
