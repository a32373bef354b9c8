"""Contacts of a hand in the world, from what its fingertips feel together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.contact_state import Contact, ContactState
from tactile_dynamics_ros.core.tactile.fingertip import TactileEstimate


def hand_contacts(
    state: ContactState, joint_positions: NDArray[np.float64], tips: TactileEstimate
) -> dict[str, Contact]:
    """Return the contacts of the fingers that touch something, by name.

    Args:
        state: state of the hand.
        joint_positions: (J,) rad, arm then hand.
        tips: what the hand's fingertips say, in the order of the robot's fingers.
    """
    touching = np.flatnonzero(tips.in_contact)
    if not touching.size:
        return {}
    fingers = [state.kinematics.fingers[k] for k in touching]
    positions = np.tile(joint_positions, (len(fingers), 1))
    measured = (values[touching] for values in (tips.force, tips.std, tips.torque))
    return dict(zip(fingers, state.update_all(fingers, positions, *measured), strict=True))
