"""Where the BioTac's electrodes sit, and how its 44 channels are ordered.

Sensor frame: x towards the finger tip, z away from the pad (towards the nail).
Source: electrode centres and normals as published with biotac_force_net and
biotac_gazebo_plugin (identical tables).
"""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array

CHANNELS = 44
"""Numbers of a frame: E1 to E19, PDC, TDC, TAC, PAC0 to PAC21. Fixed by the sensor; messages of
another length are refused."""
ELECTRODES = slice(0, 19)
"""Place of the 19 electrodes in a frame. Fixed, as the places below, by the order in which drivers
publish a frame: another place would read one signal for another."""
PDC = 19
"""Place of the static fluid pressure. Fixed by the frame's order."""
TDC = 20
"""Place of the absolute temperature. Fixed by the frame's order."""
TAC = 21
"""Place of the heat flux. Fixed by the frame's order."""
PAC = slice(22, 44)
"""Place of the 22 samples of the dynamic pressure, 2200 Hz. Fixed by the frame's order."""
FULL_SCALE = 4095
"""Largest count of a 12-bit channel. Fixed by the converter; counts beyond it are refused as no
counts, so that less would refuse strong presses."""

_LEFT_SIDE = {
    1: ((0.993, -4.855, -1.116), (0.196, -0.956, -0.220)),
    2: ((-2.700, -3.513, -3.670), (0.0, -0.692, -0.722)),
    3: ((-6.200, -3.513, -3.670), (0.0, -0.692, -0.722)),
    4: ((-8.000, -4.956, -1.116), (0.0, -0.976, -0.220)),
    5: ((-10.500, -3.513, -3.670), (0.0, -0.692, -0.722)),
    6: ((-13.400, -4.956, -1.116), (0.0, -0.976, -0.220)),
    8: ((3.031, -1.950, -3.330), (0.500, 0.0, -0.866)),
}
"""Centre (mm, sensor frame) and normal of each electrode with y < 0. Source: positions in
biotac_force_net and biotac_gazebo_plugin, which agree. A millimetre more moves contact points and
tilts forces of the analytic model; both models would have to be fitted again."""
_MIRROR = {1: 11, 2: 12, 3: 13, 4: 14, 5: 15, 6: 16, 8: 9}
"""Electrode with y > 0 that mirrors each of those. Fixed by the sensor's symmetry; a wrong pair
puts an electrode on the other side of the finger."""
_MIDDLE = {
    7: ((4.763, 0.0, -2.330), (0.500, 0.0, -0.866)),
    10: ((1.299, 0.0, -4.330), (0.500, 0.0, -0.866)),
    17: ((-2.800, 0.0, -5.080), (0.0, 0.0, -1.0)),
    18: ((-9.800, 0.0, -5.080), (0.0, 0.0, -1.0)),
    19: ((-13.600, 0.0, -5.080), (0.0, 0.0, -1.0)),
}
"""Centre and normal of electrodes in the plane of symmetry, from the same source. What is said of
`_LEFT_SIDE` holds for them."""


def _electrode_table() -> tuple[Array, Array]:
    rows = {**_LEFT_SIDE, **_MIDDLE}
    for left, right in _MIRROR.items():
        position, normal = _LEFT_SIDE[left]
        rows[right] = (
            (position[0], -position[1], position[2]),
            (normal[0], -normal[1], normal[2]),
        )
    centres: Array = 1e-3 * np.array([rows[number][0] for number in range(1, 20)])
    normals: Array = np.array([rows[number][1] for number in range(1, 20)])
    return centres, normals / np.linalg.norm(normals, axis=1, keepdims=True)


ELECTRODE_POSITION, ELECTRODE_NORMAL = _electrode_table()
"""(19, 3) metres and unit vectors in the sensor frame, electrode E1 first. Made of the tables
above, with which they move."""
