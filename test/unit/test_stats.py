"""Sizes of the house are counted rightly."""

import ast

import pytest

from benchmarks.stats import circular, code_lines, constants, imports_of

SOURCE = '''"""A module."""

import math  # why

SIZE = 3.0
"""Of something."""


def area(side):
    """Of a square."""
    text = """several
    lines"""
    # no code
    return side**2, text
'''


def test_lines_of_code_are_neither_blank_nor_comments_nor_docstrings():
    assert code_lines(SOURCE) == 6


@pytest.mark.parametrize(
    "line, count",
    [("A = 1", 1), ("A, B = 1, 2.5", 2), ("A = (1, 2)", 1), ("a = 1", 0), ("A = 'x'", 0)],
)
def test_constants_are_numbers_in_capitals(line, count):
    assert constants(ast.parse(line)) == count


def test_circles_are_found_through_folders_but_not_of_types_alone():
    modules = {
        "p": "",
        "p.a": "from p.b import x",
        "p.b": "from p import c",
        "p.c": "import p.a",
        "p.d": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import p.e",
        "p.e": "import p.d",
    }
    graph = imports_of({name: ast.parse(text) for name, text in modules.items()})
    assert sorted(circular(graph)) == ["p.a", "p.b", "p.c"]
