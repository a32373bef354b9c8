"""Measurements that a friction probe is given at one instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ProbeContact:
    """One touching finger.

    Attributes:
        point: (3,) m, world. force: (3,) N on the object, world axes. std: (3,) N.
    """

    point: Array
    force: Array
    std: Array


@dataclass(frozen=True)
class ProbeInput:
    """Everything that is measured at one instant.

    Attributes:
        time: s. touch_time: stamp of the newest touch, s.
        positions: (J,) rad.
        contacts: by finger; fingers that touch nothing are missing.
        object_pose: (4, 4) X_WO.
        vibration, electrodes: signals of the probing finger, see `SlipObservation`.
    """

    time: float
    touch_time: float
    positions: Array
    contacts: Mapping[str, ProbeContact]
    object_pose: Array
    vibration: float | None = None
    electrodes: float | None = None
