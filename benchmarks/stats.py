"""How large is the house: lines, files, depth, tuned constants, names, circles of imports."""

from __future__ import annotations

import argparse
import ast
import io
import json
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = {"package": "tactile_dynamics_ros", "benchmarks": "benchmarks", "tests": "test"}
LONG = 400
"""Lines from which a file counts as long."""
VERB = "tactile_dynamics_ros.api.discrepancies"
"""Module behind `diagnose`; with the fit behind it, it shows what one verb imports."""
_PREFIX = "tactile_dynamics_ros"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the sizes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    options = parser.parse_args(arguments)
    found = measure(ROOT)
    if options.json:
        print(json.dumps(found))
        return 0
    for name, sizes in found.items():
        print(f"{name:11s} " + ", ".join(f"{key} {value}" for key, value in sizes.items()))
    return 0


def measure(root: Path) -> dict[str, dict[str, Any]]:
    """Return sizes of package, benchmarks and tests below a folder, and what `diagnose` imports."""
    found: dict[str, dict[str, Any]] = {}
    for name, folder in FOLDERS.items():
        texts = {path: path.read_text() for path in sorted((root / folder).rglob("*.py"))}
        trees = {path: ast.parse(text) for path, text in texts.items()}
        modules = {_module(path, root): tree for path, tree in trees.items()}
        found[name] = {
            "code_lines": sum(map(code_lines, texts.values())),
            "files": len(texts),
            "long_files": sum(text.count("\n") > LONG for text in texts.values()),
            "depth": max(len(path.relative_to(root / folder).parts) - 1 for path in texts),
            "constants": sum(map(constants, trees.values())),
            "circles": len(circular(imports_of(modules))),
        }
        if name == "package":
            found[name] |= _of_package(trees) | {"modules_of_diagnose": _imported()}
    return found


def _of_package(trees: Mapping[Path, ast.Module]) -> dict[str, int]:
    """Constants of the pushed half, and names that stand for more than one thing."""
    classes = (
        node for tree in trees.values() for node in tree.body if isinstance(node, ast.ClassDef)
    )
    return {
        "pushed_constants": sum(constants(t) for p, t in trees.items() if "planar" in p.parts),
        "modules_named_twice": _twice(p.stem for p in trees if p.stem != "__init__"),
        "classes_named_twice": _twice(n.name for n in classes if not n.name.startswith("_")),
    }


def code_lines(source: str) -> int:
    """Lines that hold code: no blank ones, comments or docstrings."""
    used: set[int] = set()
    fresh = True
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT):
            fresh = True
        elif token.type not in (tokenize.NL, tokenize.COMMENT, tokenize.ENDMARKER):
            if not (fresh and token.type == tokenize.STRING):
                used.update(range(token.start[0], token.end[0] + 1))
            fresh = False
    return len(used)


def constants(tree: ast.Module) -> int:
    """Numbers in capitals at the top of a module: each of a tuple counts."""
    count = 0
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        names = [name for t in targets if t is not None for name in _names(t)]
        if names and all(name.isupper() for name in names) and getattr(node, "value", None):
            numbers = [n for n in ast.walk(node.value) if _is_number(n)]  # type: ignore[attr-defined]
            count += min(len(numbers), len(names))
    return count


def circular(graph: Mapping[str, set[str]]) -> set[str]:
    """Modules that import each other, or one that does; none where there is an order.

    Args:
        graph: modules by name, with those that each imports.
    """
    left = {name: found - {name} for name, found in graph.items()}
    while settled := {name for name, found in left.items() if not found & left.keys()}:
        left = {name: found for name, found in left.items() if name not in settled}
    return set(left)


def imports_of(modules: Mapping[str, ast.Module]) -> dict[str, set[str]]:
    """What each module imports of the others as it is loaded, leaving out what is for types."""
    return {name: _imports(tree, modules) for name, tree in modules.items()}


def _imports(tree: ast.Module, known: Iterable[str]) -> set[str]:
    """Known modules that a module imports at its top."""
    found, there = set(), set(known)
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module:
            parts = {f"{node.module}.{a.name}" for a in node.names}
            found |= parts & there or {node.module}
        elif isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
    return found & there


def _module(path: Path, root: Path) -> str:
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _names(target: ast.expr) -> Iterator[str]:
    if isinstance(target, ast.Name):
        yield target.id
    elif isinstance(target, ast.Tuple):
        for one in target.elts:
            yield from _names(one)


def _is_number(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    )


def _twice(names: Iterable[str]) -> int:
    """How many names stand for more than one thing."""
    return sum(count > 1 for count in Counter(names).values())


def _imported() -> int:
    """Modules of the package that a diagnosis loads."""
    code = (
        "import sys, tactile_dynamics_ros as td; td.diagnose; import "
        f"{VERB}, tactile_dynamics_ros.core.inertia.diagnosis.misreading, "
        "tactile_dynamics_ros.core.discrepancy.diagnosis; "
        f"print(sum(name.startswith('{_PREFIX}') for name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return int(done.stdout)
