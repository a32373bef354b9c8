"""The package installed away from its source, as a wheel and as README's workspace on a robot.

[ros] is what a robot has: README's block, typed literally, makes its workspace. [ros, sim] is a
machine with the simulator, where the package is a wheel.
"""

import importlib
import json
import os
import re
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
import rclpy
from installation import Environment, clean_copy, make_environment
from rclpy.node import Node
from rosbags.rosbag2 import Reader
from synthetic_recording import held_box

import tactile_dynamics_ros
from tactile_dynamics_ros.cli.bringup import node_names, nodes_of
from tactile_dynamics_ros.ros import interface_build

ROOT = Path(tactile_dynamics_ros.__file__).parents[1]
PACKAGE = "tactile_dynamics_ros"
COLCON = Path(sys.executable).with_name("colcon")
VIEW = {f"{PACKAGE}.view.{name}" for name in ("gate", "page", "robot")}
"""What draws the live page, which only the extra view brings a library for."""
TRAINING = {f"{PACKAGE}.core.tactile.network.training"} | {
    f"{PACKAGE}.core.planar.network.{name}" for name in ("training", "noise_training")
}
"""Modules that need torch, which the extra [train] brings."""

STAND_INS = {
    # what only apt has (launch and ros2cli are not on PyPI), or what would reach for the network
    "rosdep": "exit 0",
    "pip": 'exec {here} -m pip --python "$VIRTUAL_ENV/bin/python" "$@" --no-index',
    # a virtual environment that sees the libraries of the system: those of {root}
    "python3": """[[ "$1 $2 $3" == "-m venv --system-site-packages" ]] || exec {python} "$@"
        {here} -m venv --without-pip "$4" && cp --recursive --symbolic-link --no-clobber \\
            {root}/lib/. "$4/lib/" """,
    # ament_cmake's wheels name folders of the machine that built them, so interfaces are left out
    "colcon": 'PYTHONPATH={libraries} exec {python} {colcon} "$@" --packages-skip {interfaces}',
    "ros2": """case "$1 $2" in
        "run {package}") exec "$(echo $AMENT_PREFIX_PATH | cut -d: -f1)/lib/$2/$3" "${{@:4}}" ;;
        "launch {package}") exec tactile-dynamics up --json ;;
        "topic echo") exec tactile-dynamics echo "$3" --count 1 --json ;;
        "service call") exec tactile-dynamics call "$3" --json ;;
        "param set") exec tactile-dynamics set "${{3#/}}" "$4" "$5" ;;
    esac; exit 64""",
}

pytestmark = [
    pytest.mark.timeout(400),
    pytest.mark.skipif(not COLCON.exists(), reason="colcon is not installed"),
    pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a clone of the repository"),
]


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A clean copy of the repository, itself a repository that can be cloned."""
    copy = clean_copy(ROOT, tmp_path_factory.mktemp("source") / PACKAGE)
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-q", "-m", "copy"]):
        identity = ["-c", "user.name=test", "-c", "user.email=test@invalid"]
        subprocess.run(["git", *identity, *words], cwd=copy, check=True)
    return copy


@pytest.fixture(scope="module")
def wheel(source, tmp_path_factory):
    """The wheel of a copy."""
    folder = tmp_path_factory.mktemp("wheel")
    copy = shutil.copytree(source, folder / "source")
    words = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation"]
    done = subprocess.run([*words, "-w", folder, copy], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    (built,) = folder.glob("*.whl")
    return built


def requirements(*extras):
    """Return what the package needs with some extras, by the metadata of the source."""
    found = {}
    text = (ROOT / "setup.py").read_text()
    text = re.sub(r"^setup\(", "found.update(dict(", text, flags=re.MULTILINE) + ")"
    here = os.getcwd()
    os.chdir(ROOT)
    try:
        exec(compile(text, "setup.py", "exec"), {"found": found})
    finally:
        os.chdir(here)
    return found["install_requires"] + [r for e in extras for r in found["extras_require"][e]]


@pytest.fixture(scope="module")
def machine(wheel, tmp_path_factory):
    """[ros, sim] with the wheel."""
    root = tmp_path_factory.mktemp("machine") / "venv"
    environment = make_environment(root, requirements("ros", "sim"))
    words = [sys.executable, "-m", "pip", "--python", environment.python, "install"]
    done = environment.run(*words, "--no-deps", "--no-index", wheel)
    assert done.returncode == 0, done.stdout + done.stderr
    return environment


def robot_block():
    """Return README's lines for a robot: those that install, and those that run."""
    section = (ROOT / "README.md").read_text().partition("## On a robot with ROS 2 Jazzy")[2]
    block = section.partition("```bash\n")[2].partition("```")[0]
    install, run = block.strip().split("\n\n")
    return install, run.splitlines()


def with_stand_ins(environment, home):
    """Return the variables of a shell with stand-ins for what a robot has from apt."""
    facts = {"package": PACKAGE, "here": sys.executable, "python": environment.python}
    facts |= {"colcon": COLCON, "libraries": COLCON.parents[1] / "lib" / environment_library()}
    facts |= {"root": environment.root, "interfaces": interface_build.PACKAGE}
    tools = home / "tools"
    tools.mkdir()
    for name, body in STAND_INS.items():
        (tools / name).write_text("#!/bin/bash\n" + body.format(**facts) + "\n")
        (tools / name).chmod(0o755)
    path = f"{tools}:{environment.variables['PATH']}"
    return environment.variables | {"HOME": str(home), "PATH": path}


@pytest.fixture(scope="module")
def robot(source, tmp_path_factory):
    """[ros] with the workspace that README's block makes, sourced."""
    home = tmp_path_factory.mktemp("home")
    environment = make_environment(home / "venv", requirements("ros"))
    (home / "ws" / "src").mkdir(parents=True)
    variables = with_stand_ins(environment, home)
    typed = robot_block()[0].replace("<this repository>", str(source))
    done = subprocess.run(
        ["bash", "-ec", f"{typed}\nenv -0 >{home}/environment"],
        env=variables,
        cwd=home,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    pairs = (home / "environment").read_text().strip("\0").split("\0")
    sourced = Environment(home / "ws" / ".venv", dict(pair.split("=", 1) for pair in pairs))
    prefix = home / "ws" / "install" / PACKAGE
    assert sourced.variables["AMENT_PREFIX_PATH"].split(":")[0] == str(prefix)
    sourced.path = sourced.variables["PATH"]
    sourced.variables["PATH"] = f"{prefix / 'lib' / PACKAGE}:{sourced.variables['PATH']}"
    sourced.prefix = prefix
    return sourced


def environment_library():
    """Return the folder of libraries relative to lib/."""
    return f"python{sys.version_info.major}.{sys.version_info.minor}/site-packages"


@pytest.fixture(params=["robot", "machine"])
def installed(request):
    """Each of the two installations."""
    environment = request.getfixturevalue(request.param)
    environment.name = request.param
    return environment


IMPORT_ALL = """
import importlib, json, sys
import tactile_dynamics_ros
failed = {}
for name in sys.stdin.read().split():
    try:
        importlib.import_module(name)
    except Exception as error:
        failed[name] = f"{type(error).__name__}: {error}"
print()
print(json.dumps({"file": tactile_dynamics_ros.__file__, "failed": failed}))
"""


def modules_of(source):
    """Return the dotted names of all modules in the source."""
    paths = [p.relative_to(source).with_suffix("") for p in (source / PACKAGE).rglob("*.py")]
    return {".".join(p.parts).removesuffix(".__init__") for p in paths}


def test_every_module_imports_from_the_installed_files(installed, source):
    modules = modules_of(source)
    done = installed.run(installed.python, "-c", IMPORT_ALL, input="\n".join(sorted(modules)))
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert not Path(result["file"]).is_relative_to(ROOT)
    simulator = {name for name in modules if f"{name}.".startswith(f"{PACKAGE}.sim.")}
    assert simulator
    expected = TRAINING | VIEW | (simulator if installed.name == "robot" else set())
    assert set(result["failed"]) == expected, result["failed"]
    reasons = {result["failed"][name] for name in expected & simulator}
    assert all("tactile_dynamics_ros[sim]" in reason for reason in reasons)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A small recording of a box in the hand."""
    path = tmp_path_factory.mktemp("recording") / "box"
    held_box(seconds=10.0).to_bag(path)
    return path


def test_estimate_and_diagnose_a_recording(installed, bag):
    done = installed.run("tactile-dynamics", "estimate", bag, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["mass"]["value"] == pytest.approx(0.4, rel=0.02)
    done = installed.run("tactile-dynamics", "diagnose", bag, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["verdict"] == "adequate"


@pytest.fixture
def graph(monkeypatch):
    """A node of one test, which sees the others, and none that an earlier test has ended.

    It speaks UDP alone: a process that ends may leave a port of Fast DDS' shared memory locked, and
    whoever writes to it then waits for ever.
    """
    with monkeypatch.context() as here:
        here.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
        rclpy.init(args=[])
        node = Node("graph", enable_rosout=False, start_parameter_services=False)
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def wait_for_nodes(graph, names, processes, seconds=90.0):
    """Wait until nodes are there, and none of their processes has ended."""
    deadline = time.monotonic() + seconds
    while not set(names) <= set(graph.get_node_names()):
        assert time.monotonic() < deadline, set(names) - set(graph.get_node_names())
        assert [p.args for p in processes if p.poll() is not None] == []
        time.sleep(0.1)


@contextmanager
def playing(graph, bag):
    """Publish a recording with stamps of now, again and again, until the context is left."""
    done = threading.Event()
    with Reader(bag) as reader:
        publishers = {}
        for connection in reader.connections:
            package, _, kind = connection.msgtype.split("/")
            message = getattr(importlib.import_module(f"{package}.msg"), kind)
            publishers[connection.topic] = graph.create_publisher(message, connection.topic, 10)
        messages = [(stamp, c.topic, bytearray(raw)) for c, stamp, raw in reader.messages()]

    def play():
        while not done.is_set():
            behind = time.time_ns() - messages[0][0]
            for recorded, topic, raw in messages:
                stamp = recorded + behind
                if done.wait(max(0.0, 1e-9 * (stamp - time.time_ns()))):
                    return
                struct.pack_into("<iI", raw, 4, *divmod(stamp, 10**9))  # after CDR's own header
                publishers[topic].publish(bytes(raw))

    thread = threading.Thread(target=play)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def stop(processes):
    """Ask processes to end; return their exit codes.

    One that does not end tells in its log where it hangs.
    """
    for process in processes:
        process.send_signal(signal.SIGTERM)
    deadline = time.monotonic() + 60.0
    while any(p.poll() is None for p in processes) and time.monotonic() < deadline:
        time.sleep(0.1)
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGABRT)  # PYTHONFAULTHANDLER prints the stacks
    return [process.wait(timeout=30) for process in processes]


def test_every_executable_starts_stays_and_stops(installed, graph, tmp_path):
    names = [n for n in node_names() if n != "robot_sim" or installed.name == "machine"]
    logs = {name: tmp_path / f"{name}.log" for name in names}
    processes = []
    try:
        for name in names:
            processes.append(installed.start(name, log=logs[name]))
        wait_for_nodes(graph, names, processes)
        time.sleep(2.0)
        assert [p.args for p in processes if p.poll() is not None] == []
    finally:
        codes = stop(processes)
    text = {name: log.read_text() for name, log in logs.items()}
    failed = [f"{n}: {code}\n{text[n]}" for n, code in zip(names, codes, strict=True) if code]
    assert not failed, "\n".join(failed)  # a text is shown whole, where the process hangs too
    assert [name for name in names if "Traceback" in text[name]] == []


@pytest.mark.parametrize(
    "words",
    [["robot_sim"], ["tactile-dynamics", "sim"], ["tactile-dynamics", "demo"]],
    ids=" ".join,
)
def test_what_needs_the_simulator_names_its_extra(robot, words):
    done = robot.run(*words)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert "pip install 'tactile_dynamics_ros[sim]'" in done.stderr


def until_done(robot, line, seconds=150.0):
    """Run a line until it succeeds: what it asks for may have to be measured first.

    DDS can lose a request to a service that was just discovered; a person asks again.
    """
    deadline = time.monotonic() + seconds
    while True:
        try:
            done = robot.run("bash", "-c", line, timeout=seconds / 2)
        except subprocess.TimeoutExpired as unanswered:
            done = subprocess.CompletedProcess(line, 1, unanswered.stdout, unanswered.stderr)
        if done.returncode == 0 or time.monotonic() > deadline:
            return done


def test_readme_block_on_a_robot(robot, graph, bag, tmp_path):
    first, *others = robot_block()[1]
    assert first.startswith(f"ros2 launch {PACKAGE} bringup.launch.py")
    nodes = nodes_of(ROOT / "config" / "allegro_iiwa.yaml", simulate=False)
    processes = [robot.start("bash", "-c", f"exec {first}", log=tmp_path / "launch.log")]
    try:
        wait_for_nodes(graph, nodes, processes)
        with playing(graph, bag):
            for line in others:
                if line.startswith("ros2 run"):  # stays, as the launch does
                    log = tmp_path / "run.log"
                    processes.append(robot.start("bash", "-c", f"exec {line}", log=log))
                    continue
                done = until_done(robot, line)
                assert done.returncode == 0, (line, done.stdout, done.stderr)
        assert [p.args for p in processes if p.poll() is not None] == []
    finally:
        codes = stop(processes)
    assert codes == [0] * len(processes)
    assert "ended with" not in (tmp_path / "launch.log").read_text()


def test_the_command_alone_is_in_path_after_sourcing(robot):
    def which(name):
        return shutil.which(name, path=robot.path)

    assert which("tactile-dynamics") == str(robot.prefix / "bin" / "tactile-dynamics")
    assert [name for name in node_names() if which(name)] == []
    done = robot.run("env", f"PATH={robot.path}", "tactile-dynamics", "effects", "viscous_drag")
    assert done.returncode == 0, done.stderr
    assert "viscous_drag" in done.stdout


def test_colcon_finds_both_packages_where_readme_looks(source, tmp_path):
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / PACKAGE).symlink_to(source)
    line = next(line for line in robot_block()[0].splitlines() if line.startswith("colcon build"))
    folders = line.partition("--base-paths ")[2].partition(" &&")[0].split()
    words = [sys.executable, COLCON, "list", "--base-paths", *folders]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    found = {tuple(line.split("\t")) for line in done.stdout.splitlines()}
    assert {(name, kind) for name, _, kind in found} == {
        (PACKAGE, "(ros.ament_python)"),
        (interface_build.PACKAGE, "(ros.ament_cmake)"),
    }


def test_a_wheel_brings_one_command_of_its_own_environment(machine):
    first = (machine.root / "bin" / "tactile-dynamics").read_text().splitlines()[0]
    assert first == f"#!{machine.python}"


def test_all_that_ros2_looks_for_is_where_it_looks(robot):
    folder = robot.prefix / "lib" / PACKAGE
    found = {path.name for path in folder.iterdir() if os.access(path, os.X_OK)}
    assert {*node_names(), "tactile-dynamics"} <= found
    program = (
        "from ament_index_python.packages import get_package_prefix as p, "
        f"get_package_share_directory as s; print(p('{PACKAGE}')); print(s('{PACKAGE}'))"
    )
    done = robot.run(robot.python, "-c", program)
    prefix, share = (Path(line) for line in done.stdout.split())
    assert prefix == robot.prefix
    shipped = [*(ROOT / "config").rglob("*"), *(ROOT / "interfaces").glob("*/*")]
    configuration = [p.relative_to(ROOT) for p in shipped if p.is_file()]
    for name in ("package.xml", "launch/bringup.launch.py", *configuration):
        assert (share / name).is_file(), name


def test_executables_run_with_the_python_of_the_virtual_environment(robot):
    """Colcon itself runs with another, as apt's does."""
    own = robot.root / "bin" / "python3"
    for name in node_names():
        first = (robot.prefix / "lib" / PACKAGE / name).read_text().splitlines()[0]
        assert first == "#!/usr/bin/env python3"
    assert shutil.which("python3", path=robot.path) == str(own)
    done = robot.run("python3", "-c", "import sys; print(sys.prefix)")
    assert done.stdout.strip() == str(robot.root)


def test_the_steps_of_the_dockerfile_make_a_workspace_whose_command_runs(source, tmp_path):
    """Typed as a script, since a builder of images is not everywhere."""
    text = (ROOT / "Dockerfile").read_text().replace("\\\n", " ")
    steps = [line.partition(" ") for line in text.splitlines() if line and line[0] != "#"]
    environment = make_environment(tmp_path / "venv", requirements("ros"))
    variables = with_stand_ins(environment, tmp_path)
    for tool in ("useradd", "apt-get", "chown"):
        (tmp_path / "tools" / tool).write_text("#!/bin/bash\n")
        (tmp_path / "tools" / tool).chmod(0o755)
    (tmp_path / "ros.bash").touch()
    ways = {"COPY": "mkdir -p $(dirname {1}/x) && cp -r {0} {1}", "WORKDIR": "mkdir -p {0}; cd {0}"}
    script = ["set -e -o pipefail"]
    for word, _, rest in steps:
        if word == "RUN":
            script.append(rest.replace("rm -rf /var/lib/apt/lists/*", "true"))
        elif word in ways:
            names = [n for n in rest.split() if not n.startswith("--")]
            names[0] = f"{source}/{names[0]}" if word == "COPY" else names[0]
            script.append(ways[word].format(*names))
    (entry,) = (json.loads(rest) for word, _, rest in steps if word == "ENTRYPOINT")
    (command,) = (json.loads(rest) for word, _, rest in steps if word == "CMD")
    script.append(" ".join(map(shlex.quote, [*entry, *command])))
    typed = "\n".join(script).replace("/opt/ros/jazzy/setup.bash", str(tmp_path / "ros.bash"))
    typed = typed.replace("/home/robot", str(tmp_path))
    words = ["bash", "-c", typed]
    done = subprocess.run(words, env=variables, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "usage: tactile-dynamics" in done.stdout


def test_data_files_inside_the_package_are_installed(robot, source):
    data = [p for p in (source / PACKAGE).rglob("*") if p.is_file() and p.suffix != ".py"]
    assert data
    library = robot.prefix / "lib" / environment_library()
    assert [p for p in data if not (library / p.relative_to(source)).is_file()] == []
