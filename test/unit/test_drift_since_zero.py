"""A sensor drifts from its last zero on, which lies before the recording."""

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document
from tactile_dynamics_ros.core.inertia.diagnosis.misreading import question
from tactile_dynamics_ros.core.streams.streams import nearest_samples
from tactile_dynamics_ros.synthetic import generate

RATE = np.array([0.012, -0.008, 0.006])
"""N/s, in the axes of the finger."""
BEFORE = 40.0
"""s from the sensor's zero to the first sample."""


def drifting(streams, finger):
    """The streams with a finger whose zero drifts since before they began."""
    contact = streams.contacts[finger]
    axes = contact.rotation[nearest_samples(contact.pose_time, contact.time)]
    since = contact.time - contact.time[0] + BEFORE
    force = contact.force + since[:, None] * (axes @ RATE) * contact.force.any(axis=1)[:, None]
    return replace(streams, contacts=streams.contacts | {finger: replace(contact, force=force)})


def test_a_drift_from_before_the_recording_is_named_alone():
    streams = drifting(generate(5).streams, "thumb")
    document = diagnosis_document(diagnose(question(streams)))
    assert (document["verdict"], document["effect"]) == ("missing_effect", "force_drift")
    assert document["group"] == [], "a bias alone is not enough, and no other effect is as good"
    assert document["error"]["after"] < 1.1 < document["error"]["before"]
