"""The command's frame: exit codes, one-line errors, verbs."""

import fcntl
import json
import os
import shlex
import subprocess
import sys
from types import ModuleType

import pytest

from tactile_dynamics_ros.cli import main as cli
from tactile_dynamics_ros.cli.domain import private_domain, remove_dead_ports
from tactile_dynamics_ros.cli.progress import shown_progress
from tactile_dynamics_ros.cli.supervisor import node_command, verb_command
from tactile_dynamics_ros.cli.verbs import VERBS, Verb
from tactile_dynamics_ros.core.errors import (
    BadInputError,
    NotIdentifiableError,
    TactileDynamicsError,
    nearest_file,
)
from tactile_dynamics_ros.core.files import own_folder
from tactile_dynamics_ros.core.progress import tell
from tactile_dynamics_ros.ros.background import WORKER


def verb(run):
    """Return a module that registers one verb."""
    module = ModuleType("verb")

    def add_parser(verbs):
        parser = verbs.add_parser("work")
        parser.add_argument("--size", type=float)
        parser.set_defaults(run=run)

    module.add_parser = add_parser
    return module


def call(monkeypatch, run, *arguments):
    name = "tactile_dynamics_ros.cli.work"
    monkeypatch.setitem(sys.modules, name, verb(run))
    monkeypatch.setitem(VERBS, "work", Verb("work", "works", ()))
    return cli.main(["work", *arguments])


@pytest.mark.parametrize(
    ("error", "code"), [(BadInputError("bad\nline"), 2), (NotIdentifiableError("no motion"), 3)]
)
def test_errors_become_exit_codes_and_one_line(monkeypatch, capsys, error, code):
    def run(args):
        raise error

    assert call(monkeypatch, run) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("error: ")


def test_wrong_argument_is_bad_input(monkeypatch, capsys):
    assert call(monkeypatch, lambda args: 0, "--size", "big") == 2
    assert "--size" in capsys.readouterr().err


def test_every_verb_takes_json(monkeypatch):
    seen = []
    assert call(monkeypatch, lambda args: seen.append(args.json), "--json") == 0
    assert seen == [True]


def test_all_verbs_have_help_and_json():
    parser = cli.build_parser()
    verbs = parser._subparsers._group_actions[0].choices
    assert {"demo", "sim", "run", "up", "echo", "record", "probe", "estimate"} <= set(verbs)
    for sub in verbs.values():
        assert "--json" in sub.format_help()


def verbs():
    return cli.build_parser()._subparsers._group_actions[0].choices


def test_parsers_are_made_without_what_only_some_verbs_need():
    """`--help` comes at once, and files are read where ROS cannot be imported."""
    program = (
        "import sys; from tactile_dynamics_ros.cli.main import build_parser; build_parser(); "
        "print(*{'rclpy', 'matplotlib', 'torch', 'pybullet', 'viser'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.split() == [], done.stderr


def test_every_verb_shows_examples_that_it_takes():
    parser = cli.build_parser()
    for name, (_, _, examples) in VERBS.items():
        help_text = " ".join(verbs()[name].format_help().split())
        for example in examples:
            assert f"tactile-dynamics {example}" in help_text
            args = parser.parse_args(shlex.split(example.partition(" > ")[0]))
            assert args.verb == name


def test_every_form_of_a_verb_shows_an_example():
    for name in ("import", "synthetic"):
        (forms,) = (a for a in verbs()[name]._actions if hasattr(a, "_name_parser_map"))
        for form, parser in forms._name_parser_map.items():
            assert f"tactile-dynamics {name} {form} " in parser.format_help()


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["diagnos", "run.mcap"], "'diagnose'"),
        (["estimate", "run.mcap", "--efects", "x"], "'--effects'"),
        (["batch", "compar", "*", "--out", "o"], "'compare'"),
        (["run", "inertial_estimater"], "inertial_estimator"),
        (["effects", "viscous_drog"], "'viscous_drag'"),
        (["estimate", "run.mcap", "--model", "pushd"], "'pushed'"),
    ],
)
def test_a_name_that_is_nearly_right_is_answered_with_the_right_one(words, meant, capsys):
    assert cli.main(words) == 2
    assert meant in capsys.readouterr().err


def test_a_file_that_is_nearly_there_is_answered_with_the_one_that_is(tmp_path, capsys):
    (tmp_path / "run.mcap").touch()
    assert cli.main(["estimate", str(tmp_path / "rum.mcap")]) == 2
    assert f"did you mean '{tmp_path / 'run.mcap'}'?" in capsys.readouterr().err
    assert nearest_file(tmp_path / "gone" / "run.mcap") == ""
    assert str(tmp_path) in nearest_file(tmp_path.parent / f"{tmp_path.name}x" / "run.mcap")


def test_progress_is_a_line_of_a_terminal_and_nothing_elsewhere(monkeypatch, capsys):
    def work(quiet=False):
        with shown_progress(quiet):
            tell("trying viscous_drag")
        tell("nobody listens")
        return capsys.readouterr().err

    assert work() == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert work(quiet=True) == ""
    shown = work()
    assert "s  trying viscous_drag" in shown
    assert "nobody" not in shown
    assert shown.endswith("\r\033[K")
    assert "\n" not in shown


def test_zsh_gets_every_verb(capsys):
    assert cli.main(["completion", "zsh"]) == 0
    script = capsys.readouterr().out
    assert script.startswith("#compdef") and all(f"    {verb}:'" in script for verb in VERBS)


def test_bash_completes_verbs_options_and_choices(capsys):
    assert cli.main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    program = (
        script
        + """
        ask() {
            COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)); _shtab_tactile_dynamics
            echo "${COMPREPLY[@]}"
        }
        ask tactile-dynamics diag
        ask tactile-dynamics estimate --eff
        ask tactile-dynamics run inertial
        ask tactile-dynamics batch exp
        ask tactile-dynamics effects sloshing
        ask tactile-dynamics estimate run.mcap --effects support_t
    """
    )
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "diagnose",
        "--effects --effect-file",
        "inertial_estimator",
        "explain",
        "sloshing_mass",
        "support_tilt",
    ]


def test_unknown_verb_exits_with_2_and_no_traceback():
    command = [sys.executable, "-m", "tactile_dynamics_ros.cli.main", "fly"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_unknown_node_is_refused_with_the_known_ones(capsys):
    assert cli.main(["run", "robot"]) == 2
    assert "robot_sim" in capsys.readouterr().err


def test_demo_of_an_unknown_object_is_refused_before_anything_starts(capsys, tmp_path):
    assert cli.main(["demo", "--object", "anvil", "--out", str(tmp_path / "out")]) == 2
    assert "box_0" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_parallel_runs_get_different_domains():
    program = (
        "from tactile_dynamics_ros.cli.domain import private_domain\n"
        "import os, sys\n"
        "with private_domain() as domain:\n"
        "    print(domain, os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'], flush=True)\n"
        "    sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", program]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    runs = [subprocess.Popen(command, **pipes) for _ in range(4)]
    try:
        lines = [run.stdout.readline().split() for run in runs]
    finally:
        for run in runs:
            run.communicate("", timeout=30)
    domains = [line[0] for line in lines]
    assert len(set(domains)) == 4
    assert os.environ["ROS_DOMAIN_ID"] not in domains
    assert {line[1] for line in lines} == {"LOCALHOST"}


def test_claimed_domain_is_free_again_after_the_context(monkeypatch, tmp_path):
    monkeypatch.setenv("ROS_DOMAIN_ID", os.environ["ROS_DOMAIN_ID"])
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # claims of other runs lie elsewhere
    monkeypatch.setattr("tactile_dynamics_ros.cli.domain.DOMAINS", range(98, 99))
    for _ in range(2):
        with private_domain() as domain:
            assert domain == 98


def test_a_claim_removes_ports_of_its_domain_on_which_nobody_listens(monkeypatch, tmp_path):
    monkeypatch.setattr("tactile_dynamics_ros.cli.domain.SHARED_MEMORY", tmp_path)
    for port in (31899, 31900, 31911, 32149, 32150):  # domain 98 has 31900 to 32149
        (tmp_path / f"fastrtps_port{port}").touch()
        (tmp_path / f"sem.fastrtps_port{port}_mutex").touch()
    with (tmp_path / "fastrtps_port31911_el").open("w") as listener:
        fcntl.flock(listener, fcntl.LOCK_EX)
        remove_dead_ports(98)
    left = {path.name for path in tmp_path.iterdir() if not path.name.startswith("sem.")}
    listened_on = {"fastrtps_port31911", "fastrtps_port31911_el"}
    assert left == {"fastrtps_port31899", "fastrtps_port32150"} | listened_on
    assert len(list(tmp_path.glob("sem.*"))) == 3


def test_a_claim_follows_no_link(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("tactile_dynamics_ros.cli.domain.DOMAINS", range(98, 99))
    (tmp_path / "precious").write_text("kept")
    (own_folder() / "domain_98").symlink_to(tmp_path / "precious")
    with pytest.raises(TactileDynamicsError, match="taken"), private_domain():
        pass
    assert (tmp_path / "precious").read_text() == "kept"


def test_a_folder_that_others_could_have_made_is_refused(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    folder = own_folder()
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o755)
    with pytest.raises(BadInputError, match="others cannot enter"):
        own_folder()
    folder.rmdir()
    folder.symlink_to(tmp_path)
    with pytest.raises(BadInputError, match="not a folder of yours"):
        own_folder()
    folder.unlink()
    own_folder()
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    with pytest.raises(BadInputError, match="not a folder of yours"):
        own_folder()


@pytest.mark.parametrize(
    "command", [verb_command("--version"), node_command("robot_sim"), [*WORKER, "0"]], ids=str
)
def test_children_import_nothing_from_the_folder_they_start_in(command, tmp_path):
    (tmp_path / "tactile_dynamics_ros").mkdir()
    (tmp_path / "tactile_dynamics_ros/__init__.py").write_text("raise SystemExit('planted')")
    done = subprocess.run(
        [*command[: command.index("-m")], "-c", "import tactile_dynamics_ros"],
        cwd=tmp_path, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert "planted" not in done.stderr and done.returncode == 0


def test_demo_summary_is_plain_json_text():
    from tactile_dynamics_ros.cli.topics import to_plain

    assert json.dumps(to_plain([float("nan"), 1.5, b"\x01", (1, 2)])) == '["nan", 1.5, 1, [1, 2]]'


@pytest.mark.parametrize(
    ("verb", "option"), [("synthetic pushed out.mcap", "effect"), ("diagnose run.mcap", "effects")]
)
def test_an_option_for_effects_that_is_given_twice_adds_to_the_first(verb, option):
    parser = cli.build_parser()
    given = f"{verb} --{option} support_tilt --{option} magnet,caster"
    named = getattr(parser.parse_args(given.split()), option)
    assert named == "support_tilt,magnet,caster"
