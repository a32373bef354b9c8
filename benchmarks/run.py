"""Run a benchmark by name: ./dev bench NAME [ARGUMENTS]; without a name, list them."""

from __future__ import annotations

import ast
import importlib
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))


def find_benchmarks() -> dict[str, tuple[str, str]]:
    """Return (module, its first sentence) by name: modules and folders here that have a `main`.

    Modules of `replay` are benchmarks of their own.
    """
    found = {}
    modules = [*HERE.glob("*.py"), *HERE.glob("*/__main__.py"), *HERE.glob("replay/*.py")]
    for path in sorted(modules):
        tree = ast.parse(path.read_text())
        has_main = any(
            isinstance(node, ast.FunctionDef) and node.name == "main" for node in tree.body
        )
        if has_main and path != Path(__file__).resolve():
            parts = path.relative_to(HERE.parent).with_suffix("").parts
            sentence = (ast.get_docstring(tree) or "").split("\n")[0]
            name = parts[2] if parts[1] == "replay" else parts[1]
            found[name] = (".".join(parts), sentence)
    return found


def main(arguments: list[str]) -> int:
    """Run `main` of the named benchmark; return its exit code, 2 if there is none so named."""
    benchmarks = find_benchmarks()
    if not arguments or arguments[0] not in benchmarks:
        for name, (_, sentence) in benchmarks.items():
            print(f"  {name:12s} {sentence}")
        return 0 if not arguments or arguments[0] in ("-h", "--help") else 2
    sys.argv = [f"bench {arguments[0]}", *arguments[1:]]
    return importlib.import_module(benchmarks[arguments[0]][0]).main() or 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
