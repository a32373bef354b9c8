"""What is said of objects that no superquadric describes, and of what is open."""

import numpy as np
import pytest
import trimesh

from benchmarks.shape.camera import TableCamera
from tactile_dynamics_ros.core.shape.superquadric.scene import read_scene
from tactile_dynamics_ros.core.shape.superquadric.views import looking_at


def block(x, y, z, at=(0.0, 0.0, 0.0)):
    return trimesh.creation.box((x, y, z)).apply_translation([at[0], at[1], at[2] + 0.5 * z])


def cup():
    wall = trimesh.creation.annulus(0.037, 0.04, 0.09).apply_translation([0, 0, 0.045])
    floor = trimesh.creation.cylinder(0.038, 0.005).apply_translation([0, 0, 0.0025])
    return trimesh.util.concatenate([wall, floor])


def tray():
    sides = [
        block(*size, at=(x, y, 0))
        for x, y, *size in (
            (0.0, 0.038, 0.12, 0.004, 0.04),
            (0.0, -0.038, 0.12, 0.004, 0.04),
            (0.058, 0.0, 0.004, 0.08, 0.04),
            (-0.058, 0.0, 0.004, 0.08, 0.04),
        )
    ]
    return trimesh.util.concatenate([*sides, block(0.12, 0.08, 0.004)])


def arch():
    feet = [block(0.02, 0.04, 0.06, at=(x, 0, 0)) for x in (-0.05, 0.05)]
    return trimesh.util.concatenate([*feet, block(0.12, 0.04, 0.02, at=(0, 0, 0.06))])


def crumpled():
    """A bag: an ellipsoid with dents of a tenth of its size."""
    ball, rng = trimesh.creation.icosphere(4), np.random.default_rng(0)
    dents = [np.sin(ball.vertices @ rng.normal(size=3) * 4 + rng.uniform(0, 6)) for _ in range(3)]
    corners = ball.vertices * (1.0 + 0.12 * sum(dents))[:, None] * [0.06, 0.045, 0.03]
    corners[:, 2] -= corners[:, 2].min()
    return trimesh.Trimesh(corners, ball.faces)


def hexagon():
    return trimesh.creation.cylinder(0.05, 0.04, sections=6).apply_translation([0, 0, 0.02])


def remarks(solid):
    camera = TableCamera([solid], seed=2)
    target = np.array([0.0, 0.0, 0.03])
    directions = [(np.cos(turn), np.sin(turn), 1.0) for turn in (0.4, 2.5, 4.6)]
    clouds = [camera.look(looking_at(target + 0.35 * np.array(d), target)) for d in directions]
    camera.close()
    return read_scene(np.concatenate(clouds), 0.0).to_json()["remarks"]


@pytest.mark.parametrize(
    ("solid", "said"),
    [
        (cup(), "its top is open"),
        (tray(), "its top is open"),
        (arch(), "may be open, hollow or deformed"),
        (crumpled(), "no superquadric describes it"),
        (block(0.1, 0.06, 0.05), None),
        (hexagon(), None),
    ],
    ids=["cup", "tray", "arch", "crumpled bag", "box", "hexagon"],
)
def test_what_a_fit_cannot_say_is_said_in_words(solid, said):
    told = [text for text in remarks(solid) if "points are used" not in text]
    assert any(said in text for text in told) if said else told == []
