"""Versions: of the package, of its changelog, and of every table of docs/benchmarks.md."""

import re
import subprocess

import pytest

from benchmarks import stamps
from tactile_dynamics_ros.version import __version__

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


@pytest.fixture
def section(tmp_path, monkeypatch):
    """Two commands, the second of which fails while a file is missing."""
    monkeypatch.setattr(stamps, "RUNS", tmp_path)
    monkeypatch.setattr(stamps, "_git", lambda *words: "def5678")
    monkeypatch.setattr(stamps.Section, "changes", lambda section: 21)
    commands = (f"python -c 'open(\"{tmp_path}/log\", \"a\").write(\"x\"); print(5)'",
                f"python -c 'print(len(open(\"{tmp_path}/there\").read()))'")  # fmt: skip
    return stamps.Section("Inertia", "", "lab/x.md", "abc1234", "", commands)


def test_what_was_cut_off_goes_on_with_the_command_that_did_not_finish(section, tmp_path):
    assert stamps.run_all([section], []) == 1
    assert stamps.kept_run(section) is None
    (tmp_path / "there").write_text("1234567")
    assert stamps.run_all([section], []) == 0
    assert stamps.run_all([section], []) == 0
    assert (tmp_path / "log").read_text() == "x"
    assert stamps.kept_run(section)["commit"] == "def5678"
    assert (tmp_path / "inertia" / "0.txt").read_text() == "5\n"


def test_a_release_puts_what_was_printed_into_the_record_once(section, tmp_path, monkeypatch):
    (tmp_path / "there").write_text("1234567")
    monkeypatch.setattr(stamps, "PAGE", tmp_path / "benchmarks.md")
    record = tmp_path / "lab" / "x.md"
    record.parent.mkdir()
    record.write_text("# Record\n\n## Why\nso\n")
    for _ in range(2):
        assert stamps.run_all([section], [], release=True) == 0
    text = record.read_text()
    assert text.count("as printed at the release") == 1 and "## Why\nso\n" in text
    assert "`def5678` on " in text and "\n5\n```" in text and "\n7\n```" in text


def test_a_dry_run_warns_of_stamps_that_are_more_than_twenty_changes_old(section, monkeypatch):
    said = list(stamps.foresee([section], []))
    assert said[-1] == "warning: Inertia: stamp abc1234 is 21 changes old" and len(said) == 3
    monkeypatch.setattr(stamps.Section, "changes", lambda section: 20)
    assert not any("warning" in line for line in stamps.foresee([section], []))


def test_the_version_is_semantic_and_the_same_everywhere():
    assert re.fullmatch(r"\d+\.\d+\.\d+", __version__)
    for name, pattern in (
        ("setup.py", r'version="(.*?)"'),
        ("package.xml", r"<version>(.*?)<"),
        ("interfaces/package.xml", r"<version>(.*?)<"),
    ):
        assert re.search(pattern, (stamps.ROOT / name).read_text())[1] == __version__, name


def test_the_changelog_begins_with_this_version_and_keeps_to_its_sections():
    text = (stamps.ROOT / "CHANGELOG.rst").read_text()
    heads = re.findall(r"^(.+)\n-+$", text, re.MULTILINE)
    assert heads[0].split()[0] == __version__
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ \((forthcoming|\d{4}-\d\d-\d\d)\)", h) for h in heads)
    allowed = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"]
    for release in re.split(r"^.+\n-+\n", text, flags=re.MULTILINE)[1:]:
        found = re.findall(r"^(\w+)\n~+$", release, re.MULTILINE)
        assert found == [name for name in allowed if name in found]
        assert release.lstrip().startswith(found[0]), "an entry stands in no section"
