"""The program that follows README and docs: what it collects, runs, leaves out and calls wrong."""

import os
import shlex
from pathlib import Path

import pytest

from benchmarks.docs.__main__ import follow, summary
from benchmarks.docs.pages import ROOT, blocks, commands, pages
from benchmarks.docs.session import Session
from tactile_dynamics_ros.cli.main import build_parser

COMMAND = """#!/bin/bash
case "$1" in
    up) trap 'exit 0' INT; echo started; while :; do sleep 0.05; done ;;
    view) echo http://here; while :; do sleep 0.05; done ;;
    call) [ -e asked ] || { touch asked; echo "not yet"; exit 3; } ;;
    import) test -s "$2" && echo "it has rows" ;;
    estimate) echo "mass 1.25 0.01 kg"; exit 3 ;;
    demo) sleep 60 ;;
    *) echo "no verb $1"; exit 2 ;;
esac
"""
"""Stands in for `tactile-dynamics`: serves, refuses at first, answers with a doubt, fails."""


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Follow a page with the stand-in, and return (command, exit, note, failed) of each."""
    monkeypatch.setattr("benchmarks.docs.session.time.sleep", lambda _: os.sched_yield())
    tools, folder = tmp_path / "tools", tmp_path / "folder"
    tools.mkdir()
    folder.mkdir()
    (tools / "tactile-dynamics").write_text(COMMAND)
    (tools / "tactile-dynamics").chmod(0o755)

    def on_page(text, long_s=0.0):
        page = tmp_path / "page.md"
        page.write_text(text)
        variables = os.environ | {"PATH": f"{tools}:{os.environ['PATH']}"}
        found = Session(page, folder, variables, long_s).follow()
        return [(one.command, one.exit, one.note, one.failed) for one in found]

    return on_page


def shell(*lines):
    return "\n".join(["```bash", *lines, "```", ""])


def test_commands_are_collected_in_order_without_prompts_and_comments(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "Type `tactile-dynamics explain\ntwo.mcap --out two`, or `tactile-dynamics effects NAME`.\n"
        + shell(".venv/bin/tactile-dynamics view a  # look", "", "one \\", "  two")
        + "```console\n$ tactile-dynamics check b\nready\n```\n```yaml law.yaml\na: 1\n```\n"
    )
    found = list(blocks(page))
    assert [(c.line, c.text) for block in found for c in commands(block)] == [
        (1, "tactile-dynamics explain two.mcap --out two"),
        (4, "tactile-dynamics view a"),
        (6, "one two"),
        (10, "tactile-dynamics check b"),
    ]
    assert (found[-1].language, found[-1].name, found[-1].text) == ("yaml", "law.yaml", "a: 1\n")


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_every_documented_command_has_options_that_exist(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my_run").touch()  # `import` tells a file from a form by its being there
    parser = build_parser()
    for block in blocks(page):
        for command in commands(block):
            words = shlex.split(command.text.partition(" >")[0])
            if words[0] == "tactile-dynamics" and not {"--help", "-h"} & set(words):
                parser.parse_args(words[1:])


def test_an_answer_is_held_against_what_the_page_shows_numbers_aside(run):
    page = shell("tactile-dynamics estimate a") + "```text\nmass 7 3 kg\n```\n"
    assert run(page) == [("tactile-dynamics estimate a", 3, "", False)]
    ((_, _, note, failed),) = run(page.replace("mass 7", "weight 7"))
    assert failed
    assert note == "does not print what line 4 shows: weight 7 3 kg"


def test_a_command_that_fails_is_told_with_its_output(run):
    assert run(shell("tactile-dynamics weigh")) == [("tactile-dynamics weigh", 2, "", True)]


def test_what_lasts_is_stopped_by_ctrl_c_and_has_to_end_with_0(run):
    serves, interrupted = run(shell("tactile-dynamics up", "tactile-dynamics view"))
    assert serves == ("tactile-dynamics up", 0, "stopped by Ctrl-C", False)
    assert interrupted[1:] == (-2, "stopped by Ctrl-C", True)


def test_running_nodes_are_asked_until_they_answer(run):
    up, call = run(shell("tactile-dynamics up --simulate", "tactile-dynamics call /start"))
    assert up[1:] == (0, "stopped by Ctrl-C", False)
    assert call[1:] == (0, "asked again until there was an answer", False)


def test_what_is_long_or_needs_more_than_this_machine_is_listed(run):
    page = shell("ros2 run a b", "tactile-dynamics demo", "tactile-dynamics call /start")
    robot, demo, call = run(page)
    assert robot[2].startswith("not run: needs ROS 2 from apt")
    assert demo[1:] == (None, "long, not run", False)
    assert call[2] == "not run: needs the robot's nodes that its block starts"
    begun = run(shell("tactile-dynamics demo"), long_s=0.3)[0]
    assert begun[2].startswith("long, stopped after 0 s")
    assert not begun[3]


def test_snippets_have_the_readers_arrays_files_and_the_imports_above_them(run):
    page = "```python\nimport math\n```\n```python\nassert math.pi * len(theta) > 600\n```\n"
    assert [one[1] for one in run(page)] == [0, 0]
    assert run(shell("tactile-dynamics import log.csv"))[0][1] == 0


def test_a_page_of_the_docs_runs():
    found = list(follow([ROOT / "docs" / "effects.md"], long_s=0.0))
    assert [one.exit for one in found] == [0, 0, 0, 0, 0]
    assert summary(found)[-1] == "5 commands and snippets: 5 ran, 0 failed"
