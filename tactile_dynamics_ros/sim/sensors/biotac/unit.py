"""Parameters of the BioTac model, and how far units differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODE_NORMAL, ELECTRODE_POSITION


@dataclass(frozen=True)
class BioTacConfig:
    """Physical and electrical constants of the simulated BioTac.

    Source: facts on the sensor (electrode places, rest counts, drift of 27 to 38 counts per kelvin,
    relaxation 5 to 15 %, hysteresis 5 to 10 %, patch radius 2 mm at 0.5 N growing as the cube root
    of force). The elastic constants are chosen so that the largest fall and the largest rise of an
    electrode follow PDC as in published recordings of a real unit (at 125 PDC counts about -180 and
    +65, at 250 about -290 and +110). White noise is that of three real sensors, 0.46, 1.0 and 3.4
    counts (`benchmarks/biotac_noise.py`): the middle unit is like the second, others lie between.
    """

    fluid_gap: float = parameter(1.45e-3, "thickness of the fluid at rest", "m", 5e-4, 3e-3)
    smallest_gap: float = parameter(6e-5, "thickness that remains at full load", "m", 1e-6, 5e-4)
    patch_radius: float = parameter(2.52e-3, "contact radius at 1 N, flat object", "m", 5e-4, 1e-2)
    indentation: float = parameter(0.4, "indentation at 1 N over the gap, unsaturated", "", 0.0, 5)
    tail_length: float = parameter(
        2.0e-3, "decay of indentation outside the patch", "m", 1e-4, 1e-2
    )
    shear_stiffness: float = parameter(1.6e3, "skin shear stiffness at 1 N", "N/m", 1e2, 1e5)
    shear_gain: float = parameter(0.45, "fluid piled up per shear displacement", "", 0.0, 20.0)
    shear_reach: float = parameter(6e-3, "distance from the contact where it peaks", "m", 1e-4, 0.1)
    bulge_area: float = parameter(
        1.8e-4, "skin that bulges with displaced fluid", "m^2", 1e-5, 1e-2
    )
    local_share: float = parameter(0.75, "share of impedance from the path above", "", 0.0, 1.0)
    pressure_gain: float = parameter(100.0, "PDC counts at 1 N in the pad middle", "counts", 0, 500)
    creep_fast: float = parameter(0.05, "share of indentation that creeps in 0.2 s", "", 0.0, 0.3)
    creep_slow: float = parameter(0.05, "share of indentation that creeps in 4 s", "", 0.0, 0.3)
    hysteresis: float = parameter(0.06, "width of the loading loop over its span", "", 0.0, 0.3)
    noise: float = parameter(1.2, "white noise of an electrode, middle unit", "counts", 0.0, 50.0)
    wander: float = parameter(0.35, "slow wander of an electrode, same", "counts", 0.0, 50.0)
    wander_time: float = parameter(2.5, "correlation time of the wander", "s", 0.01, 1e4)
    pressure_noise: float = parameter(0.42, "white noise of PDC, same", "counts", 0.0, 50.0)
    loudest: float = parameter(
        2.9, "these three of the loudest unit over the middle one's", "", 1.0, 100.0
    )
    vibration_noise: float = parameter(37.0, "noise of PAC at rest", "counts", 0.0, 500.0)
    slip_vibration: float = parameter(260.0, "PAC amplitude at 35 mm/s and 1 N", "counts", 0, 4000)
    core_temperature: float = parameter(31.0, "temperature of the heated core", "degC", 0.0, 80.0)
    cold_start: float = parameter(
        0.0,
        "how much colder the core is when switched on, about 10 K on a real one",
        "K",
        0.0,
        30.0,
    )
    temperature_wander: float = parameter(0.8, "slow wander of that temperature", "K", 0.0, 20.0)
    temperature_time: float = parameter(
        240.0, "its correlation time, also of warming up", "s", 1.0, 1e5
    )
    contact_cooling: float = parameter(
        0.02, "cooling rate per newton on a cool object", "K/s", 0, 1
    )
    unit_variation: float = parameter(
        1.0, "scale of unit-to-unit differences (0: all alike)", "", 0
    )

    def __post_init__(self) -> None:
        check_ranges(self)


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
