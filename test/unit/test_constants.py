"""Constants of the core say what they are: a text below the assignment."""

import ast
import re
from pathlib import Path

import tactile_dynamics_ros

CORE = Path(tactile_dynamics_ros.__file__).parent / "core"
ELSEWHERE = ("discrepancy", "effects")
REMAINDER = {
    "friction/discrepancy_model.py: _ITERATIONS",
    "friction/discrepancy_model.py: _STEP",
    "friction/discrepancy_model.py: _REFINEMENTS",
    "friction/effects.py: REFERENCE_SPEED",
    "friction/effects.py: STATIC",
    "friction/effects.py: KINETIC",
    "friction/effects.py: CATALOGUE",
    "friction/separating_slips.py: _FORCES",
    "friction/separating_slips.py: _SPEEDS",
    "friction/separating_slips.py: _TURNS",
    "friction/separating_slips.py: _NOTABLE",
}
"""Constants that are not explained yet: none is added; whoever explains one takes it off."""


def constants(module):
    """Yield name, value and explanation (or None) of each constant of a module's source."""
    body = ast.parse(module).body
    for statement, after in zip(body, [*body[1:], None], strict=True):
        targets = getattr(statement, "targets", [getattr(statement, "target", None)])
        parts = [part for t in targets for part in getattr(t, "elts", [t])]
        names = [part.id for part in parts if isinstance(part, ast.Name)]
        for name in names if isinstance(statement, ast.Assign | ast.AnnAssign) else ():
            if re.fullmatch(r"_?[A-Z][A-Z0-9_]*", name) and name != "TYPE_CHECKING":
                yield name, statement.value, explanation(after)


def explanation(statement):
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return statement.value.value if isinstance(statement.value.value, str) else None
    return None


def all_constants():
    for path in sorted(CORE.rglob("*.py")):
        place = path.relative_to(CORE)
        if place.parts[0] not in ELSEWHERE:
            for name, value, text in constants(path.read_text()):
                yield f"{place}: {name}", value, text


def test_every_constant_of_the_core_is_explained():
    silent = {place for place, _, text in all_constants() if text is None}
    assert silent <= REMAINDER, f"say below it what it is and why: {sorted(silent - REMAINDER)}"


def test_a_number_is_explained_in_a_sentence():
    numbers = [
        (place, text)
        for place, value, text in all_constants()
        if text and isinstance(value, ast.Constant) and isinstance(value.value, float)
    ]
    short = [place for place, text in numbers if len(text.split()) < 8]
    assert len(numbers) > 100 and not short


def test_a_constant_without_text_is_found():
    source = '_A = 1.0\n"""One."""\n_B, C = 2, 3\nD: int = 4\nlower = 5\nE = 6\n# six\n"""Six."""\n'
    found = {name: text for name, _, text in constants(source)}
    assert found == {"_A": "One.", "_B": None, "C": None, "D": None, "E": "Six."}
