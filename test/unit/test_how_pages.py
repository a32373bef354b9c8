"""Pages by question: what they tell to type works, and prints what they show."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from tactile_dynamics_ros.cli import main as cli
from tactile_dynamics_ros.core.effects import registry
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = sorted((DOCS / "how").glob("*.md"))
LIVE = {
    "batch",
    "call",
    "demo",
    "echo",
    "explain",
    "probe",
    "push",
    "record",
    "run",
    "set",
    "up",
    "view",
}
"""Verbs that talk to running nodes, or take long and have tests of their own: that
they take what is typed is all that is asked here."""
OF_THE_READER = ("my_run", "second.mcap", " run ", " run\n", "--assume torque_unit")
"""Commands on data that only the reader has."""
MOST_LINES = 120


def blocks(page):
    """Return language, name of a file and text of each block of code."""
    return re.findall(r"```(\w+) ?([\w.]*)\n(.*?)```", page.read_text(), re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where all pages are followed, with the files that readers bring."""
    where = tmp_path_factory.mktemp("reader")
    write_cloud(where / "cloud.ply")
    write_log(where / "log.csv")
    (where / "my_run").mkdir()
    return where


def write_cloud(file):
    """A box of 80 x 50 x 40 mm on a table, with 0.5 mm of noise."""
    random = np.random.default_rng(0)
    table = np.column_stack([random.uniform(-0.2, 0.2, (400, 2)), np.zeros(400)])
    table = table[(np.abs(table[:, 0]) > 0.04) | (np.abs(table[:, 1]) > 0.025)]
    size = np.array([0.08, 0.05, 0.04])
    sides = random.uniform(-0.5, 0.5, (500, 3))
    axis = random.choice(3, 500, p=[0.25, 0.35, 0.4])
    sides[np.arange(500), axis] = np.where(axis == 2, 0.5, random.choice([-0.5, 0.5], 500))
    points = np.vstack([table, sides * size + [0.0, 0.0, 0.02]])
    points += random.normal(0.0, 5e-4, points.shape)
    lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
    lines += [f"property float {axis}" for axis in "xyz"] + ["end_header"]
    file.write_text("\n".join(lines) + "\n" + "\n".join(f"{x:f} {y:f} {z:f}" for x, y, z in points))


def write_log(file):
    """A wrist with 1.2 kg and a bias, as a controller logs it."""
    from scipy.spatial.transform import Rotation

    random = np.random.default_rng(1)
    time = np.arange(0.0, 10.0, 0.02)
    turn = Rotation.from_rotvec(0.8 * np.sin(np.outer(time, [2.9, 3.7, 2.1])))
    gravity = turn.inv().apply([0.0, 0.0, -9.81])
    force = 1.2 * gravity + [3.0, -2.0, 5.0] + random.normal(0.0, 0.05, (len(time), 3))
    torque = np.cross([0.01, 0.0, 0.06], 1.2 * gravity) + random.normal(0, 0.003, (len(time), 3))
    quaternion = turn.as_quat()
    place = np.tile([0.4, 0.1, 0.5], (len(time), 1)) + random.normal(0, 1e-4, (len(time), 3))
    rows = np.column_stack([time, place, quaternion, force, torque])
    names = "time,x,y,z,qx,qy,qz,qw,fx,fy,fz,tx,ty,tz"
    np.savetxt(file, rows, delimiter=",", header=names, comments="", fmt="%.6f")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_short_and_its_links_lead_somewhere(page):
    text = page.read_text()
    assert len(text.splitlines()) <= MOST_LINES
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_followed_from_top_to_bottom(page, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    for catalogue in (registry.HELD, PUSHED):
        catalogue.create(catalogue.names()[0])  # reads it all, so that the copy has all of it
        monkeypatch.setattr(catalogue, "_known", dict(catalogue._known))
    said = ""
    for language, name, text in blocks(page):
        if name:
            (folder / name).write_text(text)
        if language == "bash":
            said = "".join(type_in(line, capsys) for line in text.splitlines())
        elif language == "python":
            exec(compile(text, page.name, "exec"), {"__name__": "__main__"})
            said = capsys.readouterr().out
        elif language == "text":
            for line in text.splitlines():
                assert without_numbers(line) in without_numbers(said), f"{line}\nnot in\n{said}"


def without_numbers(text):
    return re.sub(r"-?\d[\d.]*", "#", " ".join(text.split()))


_ANSWERS: dict[str, str] = {}


def type_in(line, capsys):
    """Run a line once and return what it prints; only parse what needs nodes or a reader's data."""
    words = shlex.split(line.partition(" #")[0])
    if not words:
        return ""
    assert words[0] == "tactile-dynamics", line
    parser = cli.build_parser(cli.load_modules())
    args = parser.parse_args(words[1:])
    if args.verb in LIVE or any(own in f"{line}\n" for own in OF_THE_READER):
        return ""
    if line not in _ANSWERS:
        code = cli.main(words[1:])
        printed = capsys.readouterr()
        assert code in (0, 3), f"{line}: {printed.err}"
        _ANSWERS[line] = printed.out + printed.err
    return _ANSWERS[line]
