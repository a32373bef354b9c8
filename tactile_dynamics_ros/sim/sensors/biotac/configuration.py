"""Parameters of the BioTac model: what all units share, and how far units differ."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_dynamics_ros.core.configuration import check_ranges, parameter


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
