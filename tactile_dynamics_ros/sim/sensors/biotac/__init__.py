"""A physical model of the BioTac fingertip: contact force and place in, raw counts out.

The chain is skin -> fluid -> electrodes: a contact indents the skin, the fluid path above nearby
electrodes gets thinner and its impedance rises, the displaced fluid bulges the skin elsewhere and
raises the pressure. Nothing here is shared with the estimators that read the counts.
"""

from tactile_dynamics_ros.sim.sensors.biotac.sensor import BioTacArray
from tactile_dynamics_ros.sim.sensors.biotac.unit import BioTacConfig

__all__ = ["BioTacArray", "BioTacConfig"]
