"""Friction that differs over the table: found as a field, and not taken for a slope."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.planar.diagnosis.variation import (
    SLOPE,
    VARIATION,
    Table,
    _chosen,
    hidden_slope,
    likeliest_table,
)
from tactile_dynamics_ros.core.planar.effects.regional import STEP

NOISE = 0.02
"""Relative force that one sample tells."""


class Line:
    """Pushes along lines over a table, each sample of which tells the friction at its place."""

    def __init__(self):
        along = np.linspace(-0.1, 0.1, 40)
        self.place = np.concatenate([[[x, y] for x in along] for y in (-0.06, 0.0, 0.07)])

    def field(self, length):
        """Rows by spots as the diagnosis makes them, of an object as small as a point."""
        grid = np.arange(-0.2, 0.2 + length, length)
        spots = np.array([[x, y] for x in grid for y in grid])
        squared = np.sum((self.place[:, None] - spots) ** 2, axis=2)
        return self._rows(np.sqrt(2.0 / np.pi) * np.exp(-squared / length**2))

    def _rows(self, columns):
        return np.repeat((columns / NOISE)[:, None], 3, axis=1) * [[[1.0], [0.0], [0.0]]]

    def told(self, friction, random, others=None):
        """The table that is found where friction (R,) differs; others by name as `friction`."""
        noise = random.normal(size=len(friction))
        seen = friction / NOISE + noise

        def white(along, motion, poses):
            shrunk = np.hypot(1.0, along / NOISE)
            volume = len(seen) * np.log(shrunk)
            return seen / shrunk, motion[:, 0] / shrunk, volume

        none = np.zeros((1, 3, 1))
        even = self._rows(np.ones((len(self.place), 1)))
        slope = self._rows(2.0 * self.place), np.zeros((1, 3, 2))
        turn = self._rows(self.place[:, :1] ** 2 * 20.0), none
        effects = [(SLOPE, slope), ("turn", turn)]
        effects += [(n, (self._rows(c[:, None]), none)) for n, c in (others or {}).items()]
        return likeliest_table(white, (even, none), effects, self.field)

    def draw(self, random, size):
        """Friction of a table with a field, drawn from its covariance."""
        squared = np.sum((self.place[:, None] - self.place) ** 2, axis=2)
        root = np.linalg.cholesky(np.exp(-squared / (2.0 * 0.035**2)) + 1e-8 * np.eye(len(squared)))
        return size * root @ random.normal(size=len(root))


@pytest.fixture(scope="module")
def line():
    return Line()


def test_a_field_is_found_at_its_size(line):
    found = [line.told(line.draw(np.random.default_rng(k), 0.05), np.random.default_rng(k + 50))
             for k in range(6)]  # fmt: skip
    assert sum(table.field > 0.0 for table in found) >= 5
    assert 0.02 <= np.median([table.field for table in found]) <= 0.07


def test_noise_and_a_slope_are_no_field(line):
    for k in range(2):
        random = np.random.default_rng(k)
        assert line.told(np.zeros(len(line.place)), random).field == 0.0
        table = line.told(line.place @ np.array([1.5, -1.0]), random)
        assert table.field == 0.0
        assert table.along <= 0.01


def test_a_slope_over_a_small_place_could_be_a_field(line):
    """Over a quarter of the places a smooth field has a slope and nothing else."""
    line = Line()
    slope = np.array([1.5, -1.0])
    assert not line.told(line.place @ slope * 3.0, np.random.default_rng(1)).imitating
    line.place = 0.25 * line.place
    assert line.told(line.place @ slope, np.random.default_rng(2)).imitating


def test_a_slope_is_more_than_a_field_only_where_it_is_steep(line):
    """On tables with a field a slope that fields of that size make is none."""
    slight, steep = np.array([0.2, 0.1]), np.array([2.5, -2.0])
    random = np.random.default_rng(4)
    field = line.draw(random, 0.05)
    table = line.told(field + line.place @ slight, random)
    assert table.field > 0.0
    assert table.imitating == table.field
    table = line.told(field + line.place @ steep, random)
    assert table.field <= 0.05
    assert table.imitating == 0.0


def test_what_a_field_may_be_beyond_the_chosen_one_is_told(line):
    """Few places leave larger fields likely; that none is allowed does not make them unlikely."""
    random = np.random.default_rng(7)
    many = line.told(line.draw(random, 0.01), random)
    line = Line()
    line.place = 0.1 * line.place[::6]
    few = line.told(np.zeros(len(line.place)), random)
    assert few.unsure > 2.0 * many.unsure
    assert np.hypot(few.unsure, few.field) > 0.02


def test_a_slope_hides_behind_what_else_may_differ():
    random = np.random.default_rng(5)
    columns, noise = random.normal(size=(200, 2)), np.zeros(200)
    free = hidden_slope(columns, np.zeros((200, 0)), noise)
    assert free == pytest.approx(2.0 / np.sqrt(1.0 + 200.0), rel=0.2)
    basis = np.linalg.qr(columns[:, :1])[0]
    assert hidden_slope(columns, basis, noise) == pytest.approx(2.0, abs=0.01)
    seen = hidden_slope(columns, np.zeros((200, 0)), columns @ np.array([0.0, 0.9]))
    assert seen == pytest.approx(0.9 + free, rel=0.05)


def test_a_film_on_one_side_is_no_field(line):
    """What clearly does better behind one of several borders is told, and the field stays small."""
    random = np.random.default_rng(6)
    push = np.repeat(np.arange(3.0), 40)
    film = {f"film[x>{a:g}]": (line.place[:, 0] > a) * (push - 1.0) for a in (-0.04, 0.0, 0.04)}
    friction = line.draw(random, 0.03) + 0.5 * film["film[x>0]"]
    assert line.told(friction, random, film).regional == "film[x>0]"
    assert line.told(line.draw(random, 0.05), random, film).regional == ""


def test_a_field_alone_is_presumed_where_it_is_likelier_than_any_effect():
    """An effect on an even table need not be beaten clearly by what all tables have."""
    even, field = Table(0.003), Table(0.003, 0.02)
    close = {("", even): -8.0, ("change", even): -1.0, ("", field): -0.5, ("change", field): 0.0}
    assert _chosen(close).field == 0.02
    assert _chosen(close | {("change", even): 0.0}).field == 0.0
    ahead = {("", even): -90.0, ("film", even): -60.0, ("", field): -50.0}
    small = Table(0.003, 0.01)
    assert _chosen(ahead | {("film", small): 0.0, ("", small): -80.0}) == replace(
        small, imitating=0.01
    )


def test_a_step_by_place_must_beat_fields_as_a_slope_must(line):
    random = np.random.default_rng(7)
    beyond = {f"{STEP}[x>{a:g}]": 1.0 * (line.place[:, 0] > a) for a in (-0.03, 0.03)}
    field = line.draw(random, 0.05)
    assert line.told(field, random, beyond).regional == ""
    step = line.told(field + 0.6 * beyond[f"{STEP}[x>0.03]"], random, beyond)
    assert step.regional == f"{STEP}[x>0.03]"


def test_a_field_is_told_beside_an_adequate_model():
    assert VARIATION != SLOPE
    assert Table(0.003).remark == ""
    assert "by 4 % or so, over distances of 30 mm" in Table(0.003, 0.04, 0.03).remark
    assert Table(0.03, 0.04).total == pytest.approx(0.05)


def test_of_each_effect_in_a_regime_the_likeliest_is_a_suspect(line):
    """What acts for a while is another kind than what acts beyond a border."""
    x = line.place[:, 0]
    others = {f"{STEP}[x>{border:g}]": 1.0 * (x > border) for border in (-0.05, 0.0, 0.05)}
    others |= {f"constant_pull[{gate}]": 0.3 * np.sign(line.place[:, 1]) for gate in ("x>0", "t>3")}
    random = np.random.default_rng(3)
    table = line.told(0.3 * (x > 0.0), random, others)
    assert table.suspects[0] == f"{STEP}[x>0]"
    assert set(table.suspects[1:]) == {"constant_pull[x>0]", "constant_pull[t>3]"}
    assert line.told(0.0 * x, random).suspects == ()
