"""Every table of docs/benchmarks.md says of which version it is, and stale ones are found."""

import subprocess

import pytest

from benchmarks import stamps

SECTIONS = stamps.read_sections(stamps.PAGE.read_text())
PAGE = """# Page
intro

## Inertia
`./dev bench inertia` ([record](x.md), as of `abc1234`).

| a | b |
"""


def test_every_section_has_a_stamp_of_a_version_and_commands():
    assert [section.title for section in SECTIONS] == list(stamps.MEASURED)
    for section in SECTIONS:
        assert section.commands, section.title
        assert all((stamps.ROOT / path).exists() for path in stamps.MEASURED[section.title])


def test_stamps_are_versions_of_this_repository():
    done = subprocess.run(["git", "rev-parse", "--is-shallow-repository"], cwd=stamps.ROOT,
                          capture_output=True, text=True)  # fmt: skip
    if done.returncode or done.stdout.strip() == "true":
        pytest.skip("not a whole clone")
    assert all(section.changes() is not None for section in SECTIONS)


def test_a_page_has_one_table_per_subject_on_150_lines():
    assert len(stamps.PAGE.read_text().splitlines()) <= 150


def test_what_changed_since_is_marked_and_a_new_stamp_ends_it(monkeypatch):
    monkeypatch.setattr(stamps.Section, "changes", lambda section: 3)
    marked = stamps.mark(PAGE)
    assert "as of `abc1234`, 3 changes since)" in marked
    assert stamps.mark(marked) == marked
    fresh = stamps.restamp(marked, "Inertia", "def5678", "2 x EPYC")
    assert "as of `def5678` on 2 x EPYC)" in fresh
    monkeypatch.setattr(stamps.Section, "changes", lambda section: 0)
    assert stamps.mark(fresh) == fresh


def test_a_run_is_kept_with_its_version_and_not_repeated(tmp_path, monkeypatch):
    monkeypatch.setattr(stamps, "RUNS", tmp_path)
    monkeypatch.setattr(stamps, "_git", lambda *words: "def5678")
    ran, run = [], stamps.run_section
    monkeypatch.setattr(stamps.Section, "changes", lambda section: 3)
    section = stamps.Section("Inertia", "", "abc1234", "", ("python -c 'print(5)'",))
    monkeypatch.setattr(stamps, "run_section", lambda one: ran.append(1) or run(one))
    assert stamps.run_all([section], []) == 0
    assert stamps.run_all([section], []) == 0
    assert len(ran) == 1
    assert stamps.kept_run("Inertia")["commit"] == "def5678"
    assert (tmp_path / "inertia" / "0.txt").read_text() == "5\n"
