"""Recordings of pushes with other signs, units and axes: named before anything is fitted."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.misreading import assumed, check_reading, misread
from tactile_dynamics_ros.synthetic import pushed


@pytest.fixture(scope="module")
def recordings():
    """Six pushes each of three objects that are not round: the yaw of others touches nothing."""
    return [made.streams for made in pushed.generate([3, 4, 7], {}, pushed.PushOptions())]


def _contacts(streams, **change):
    made = {
        name: replace(c, **{k: f(getattr(c, k)) for k, f in change.items()})
        for name, c in streams.contacts.items()
    }
    return replace(streams, contacts=made)


def _poses(streams, factor):
    return replace(
        streams, links=tuple(replace(k, pose=k.pose * np.array(factor)) for k in streams.links)
    )


def _flip(values):
    return values * np.array([1.0, -1.0, 1.0])


WRONG = {
    "force_sign": lambda s: _contacts(s, force=np.negative),
    "angle_unit": lambda s: _poses(s, [1.0, 1.0, 180.0 / np.pi]),
    "position_unit": lambda s: _poses(s, [1e3, 1e3, 1.0]),
    "mirrored_axes": lambda s: _contacts(s, force=_flip, point=_flip, normal=_flip),
}


def test_right_recordings_are_read_as_they_are(recordings):
    assert [misread(streams) for streams in recordings] == [None] * len(recordings)


@pytest.mark.parametrize("name", sorted(WRONG))
def test_another_reading_is_named_and_undone(recordings, name):
    for streams in recordings:
        wrong = WRONG[name](streams)
        with pytest.raises(BadInputError, match=f"--assume {name}"):
            check_reading(wrong)
        right, _ = assumed(wrong, name)
        check_reading(right)
        assert np.allclose(right.links[0].pose, streams.links[0].pose, rtol=1e-9)


def test_an_unknown_convention_names_the_nearest(recordings):
    with pytest.raises(BadInputError, match="force_sign"):
        assumed(recordings[0], "force_sing")
