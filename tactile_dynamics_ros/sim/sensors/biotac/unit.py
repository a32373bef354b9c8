"""Unit-to-unit variation: every simulated sensor has constants of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODE_NORMAL, ELECTRODE_POSITION
from tactile_dynamics_ros.sim.sensors.biotac.configuration import BioTacConfig

Array = NDArray[np.float64]

_LEFT = [2656, 3229, 3254, 3074, 3232, 3047, 2753, 2895]
_RIGHT = [2921, 3020, 2618, 3211, 3228, 3019, 3192, 3006]
REST_COUNTS = np.array(_LEFT + _RIGHT + [3149, 3225, 3167], dtype=float)
"""(19,) counts of one individual at 30 degC; other units differ by several hundred."""

CURRENT_HALF_WIDTH = 1.5e-3
"""Half width of the fluid that an electrode's current crosses, m."""
GAP_STD = STIFFNESS_STD = 0.015
PRESSURE_GAIN_STD = LOCAL_SHARE_STD = 0.02
"""How far these differ between units, relative to their means."""
NODE_STD = 8e-5
"""How far the skin's points above an electrode lie off their place, m along each axis."""
_PATTERN = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], dtype=float)


@dataclass(frozen=True)
class Units:
    """Constants of U individual sensors.

    Attributes:
        nodes: (U, 19, 5, 3) points of the inner skin above each electrode, sensor frame, m.
        rest_counts: (U, 19) counts at 30 degC without contact.
        local_share: (U, 19) share of the impedance that lies in the path above the electrode.
        gap: (U,) fluid gap, m.
        stiffness: (U,) skin stiffness relative to nominal.
        pressure_gain: (U,) PDC counts at 1 N.
        pressure_rest: (U,) PDC counts without contact.
        temperature_slope: (U, 19) counts per kelvin.
        vibration_rest: (U,) PAC counts at rest.
        heat_flux_rest: (U,) TAC counts at rest.
        loudness: (U,) noise of electrodes and PDC over that of the middle unit.
    """

    nodes: Array
    rest_counts: Array
    local_share: Array
    gap: Array
    stiffness: Array
    pressure_gain: Array
    pressure_rest: Array
    temperature_slope: Array
    vibration_rest: Array
    heat_flux_rest: Array
    loudness: Array


def draw_units(count: int, config: BioTacConfig, rng: np.random.Generator) -> Units:
    """Draw the constants of ``count`` sensors around the nominal ones.

    Rest counts differ by several hundred as on real units. No figures for the spread of gains are
    published; about two percent each is assumed for skin, gap, electrodes and pressure. Noise is
    as likely to be twice as loud as half as loud, up to the loudest and down to the quietest.
    """
    spread = config.unit_variation

    def vary(std: float, *shape: int) -> Array:
        return spread * std * rng.standard_normal((count, *shape))

    gap = config.fluid_gap * np.exp(vary(GAP_STD))
    offset = vary(NODE_STD, 19, 3)
    return Units(
        nodes=_skin_nodes(gap, offset),
        rest_counts=REST_COUNTS + vary(150.0, 1) + vary(40.0, 19),
        local_share=np.clip(config.local_share * np.exp(vary(LOCAL_SHARE_STD, 19)), 0.0, 1.0),
        gap=gap,
        stiffness=np.exp(vary(STIFFNESS_STD)),
        pressure_gain=config.pressure_gain * np.exp(vary(PRESSURE_GAIN_STD)),
        pressure_rest=2050.0 + vary(60.0),
        temperature_slope=31.7 + vary(2.5, 19),
        vibration_rest=2000.0 + vary(25.0),
        heat_flux_rest=2300.0 + vary(120.0),
        loudness=config.loudest ** (spread * rng.uniform(-1.0, 1.0, count)),
    )


def _skin_nodes(gap: Array, offset: Array) -> Array:
    """Return points of the skin along each electrode's normal, in a cross around it."""
    normal = ELECTRODE_NORMAL
    lengthwise = np.array([1.0, 0.0, 0.0]) - normal[:, :1] * normal
    lengthwise /= np.linalg.norm(lengthwise, axis=1, keepdims=True)
    across = np.cross(normal, lengthwise)
    cross = CURRENT_HALF_WIDTH * (
        _PATTERN[:, :1] * lengthwise[:, None] + _PATTERN[:, 1:] * across[:, None]
    )
    above = ELECTRODE_POSITION + offset + gap[:, None, None] * normal
    nodes: Array = above[:, :, None, :] + cross
    return nodes
