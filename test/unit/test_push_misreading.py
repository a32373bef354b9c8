"""Recordings of pushes with other signs, units and axes: named before anything is fitted."""

import numpy as np
import pytest

from benchmarks.pushed.conventions import MISTAKES, with_contacts
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.diagnosis.discrepancy_model import PushDiscrepancy
from tactile_dynamics_ros.core.planar.misreading import assumed, check_reading, misread
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.synthetic import pushed


@pytest.fixture(scope="module")
def recordings():
    """Six pushes each of three objects that are not round: the yaw of others touches nothing."""
    return [made.streams for made in pushed.generate([3, 4, 7], {}, pushed.PushOptions())]


def test_right_recordings_are_read_as_they_are(recordings):
    assert [misread(streams) for streams in recordings] == [None] * len(recordings)


@pytest.mark.parametrize("mistake", sorted(MISTAKES))
def test_another_reading_is_named_and_undone(recordings, mistake):
    name, change = MISTAKES[mistake]
    for streams in recordings:
        wrong = change(streams)
        with pytest.raises(BadInputError, match=f"--assume {name}"):
            check_reading(wrong)
        right, _ = assumed(wrong, name)
        check_reading(right)
        assert np.allclose(right.links[0].pose, streams.links[0].pose, rtol=1e-9)


def test_the_right_forces_are_found_of_wrong_units(recordings):
    for factor, said in ((1e3, "mN"), (1e-3, "kN")):
        for streams in recordings:
            wrong = with_contacts(streams, force=lambda force, by=factor: by * force)
            wrong = with_contacts(wrong, force_std=lambda std, by=factor: by * std)
            right, reading = assumed(wrong, "force_unit")
            assert said in reading.change
            assert np.allclose(right.contacts["pusher"].force, streams.contacts["pusher"].force)


def test_every_door_asks_how_numbers_are_read(recordings):
    wrong = MISTAKES["forces in mN"][1](recordings[0])
    for door in (estimate, PushDiscrepancy.of_streams):
        with pytest.raises(BadInputError, match="in mN"):
            door(wrong)


def test_an_unknown_convention_names_the_nearest(recordings):
    with pytest.raises(BadInputError, match="force_sign"):
        assumed(recordings[0], "force_sing")


def test_degrees_show_on_round_objects_by_how_far_they_turn():
    options = pushed.PushOptions(actions=pushed.ActionOptions(count=2))
    disc = pushed.generate([1300], {}, options)[0].streams
    assert misread(disc) is None
    found = misread(MISTAKES["yaw in degrees"][1](disc))
    assert found is not None and found.name == "angle_unit"
