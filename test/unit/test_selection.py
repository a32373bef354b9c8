"""Of the readings of one effect the plainest that leaves noise is kept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from tactile_dynamics_ros.core.discrepancy.regimes.border import find_border_of
from tactile_dynamics_ros.core.discrepancy.screening import Family, screen
from tactile_dynamics_ros.core.discrepancy.selection import choose_effect

CHANNELS, INSTANTS, SENSORS = 3, 400, 4
FLOOR = 1.0


@dataclass(frozen=True)
class Denoised:
    """A linear model whose thorough fit denoises its signals as the reading that it has tells it.

    Attributes:
        measured: what is explained. followed: errors of each sensor, which the thorough fit of the
            free reading follows, and that of the common one takes for noise.
        found: the reading that it has, if any.
    """

    measured: np.ndarray
    followed: np.ndarray
    effects: tuple[Family, ...]
    found: Family | None = None
    share: float = 0.9
    noise_level: float = 0.0

    def imitators(self, name: str) -> tuple[str, ...]:
        return ()

    @property
    def time(self) -> np.ndarray:
        return np.repeat(np.arange(INSTANTS) / 20, CHANNELS)

    @property
    def raw(self) -> np.ndarray:
        return self.measured + self.share * self.followed

    @property
    def jacobian(self) -> np.ndarray:
        mean = np.ones((len(self.measured), 1))
        return np.hstack([mean, self.found.columns]) if self.found else mean

    @property
    def residual(self) -> np.ndarray:
        return self.raw - self.jacobian @ np.linalg.lstsq(self.jacobian, self.raw, rcond=None)[0]

    @property
    def freedom(self) -> float:
        return float(self.jacobian.shape[1])

    def families(self, names=None) -> list[Family]:
        return [family for family in self.effects if names is None or family.name in names]

    def with_effect(self, family: Family, coefficients: np.ndarray) -> Denoised:
        return replace(self, found=family)

    def without_effect(self, name: str) -> Denoised:
        return replace(self, found=None)

    def refined(self) -> Denoised:
        return replace(self, share=1.0 if self.found.reading == "" else 0.0)

    def is_possible(self, name: str) -> bool:
        return True


def readings(rng: np.random.Generator) -> tuple[Family, Family]:
    columns = rng.normal(size=(CHANNELS * INSTANTS, SENSORS))
    columns /= np.linalg.norm(columns, axis=0)
    total = columns.sum(axis=1, keepdims=True)
    return (
        Family("offset", "offset", "", columns, tuple(range(SENSORS))),
        Family("offset", "offset:common", "common", total, (0,)),
    )


def chosen(share: np.ndarray, followed: np.ndarray) -> str:
    """Label of the reading that is chosen for sensors that are off by these shares."""
    rng = np.random.default_rng(5)
    free, common = readings(rng)
    noise = rng.normal(size=len(free.columns))
    model = Denoised(noise + free.columns @ (20.0 * share), free.columns @ followed, (free, common))
    return choose_effect(model, screen(model, model.families(), FLOOR), FLOOR).best.label


def test_one_offset_of_all_sensors_is_told_as_one_though_the_fit_of_four_follows_its_own():
    off = np.array([4.0, -3.0, 3.0, -4.0])
    assert chosen(np.ones(SENSORS), off) == "offset:common"


def test_offsets_that_differ_stay_apart():
    assert chosen(np.array([1.0, -1.0, 0.5, 2.0]), np.zeros(SENSORS)) == "offset"


def test_an_effect_that_the_model_has_everywhere_has_no_border_to_be_found_again():
    model = SimpleNamespace(families=lambda names: [])
    condition, gate = SimpleNamespace(values=np.arange(9.0)), SimpleNamespace()
    assert find_border_of(model, "force_bias", "force_bias:@sensor", condition, gate, 1.0) is None
