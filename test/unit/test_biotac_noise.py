"""Noise of real sensors is found in their recordings, whatever moves slowly below it."""

import io
import tarfile

import numpy as np
import pytest

from benchmarks.biotac_noise import run as measure_all
from benchmarks.biotac_noise import sliding, touching, white_noise
from tactile_dynamics_ros.core.errors import BadInputError


def wandering(rng: np.random.Generator, noise: float, columns: int) -> np.ndarray:
    slow = 200.0 + 40.0 * np.sin(np.linspace(0.0, 3.0, 300))[:, None]
    return np.rint(slow + noise * rng.standard_normal((300, columns)))


def pack(path, tables: dict[str, np.ndarray]) -> None:
    path.parent.mkdir(parents=True)
    with tarfile.open(path, "w:gz") as archive:
        for name, table in tables.items():
            rows = [",".join(f"{value:g}" for value in row) for row in table]
            text = "\n".join(["heading", *rows]).encode()
            entry = tarfile.TarInfo(name)
            entry.size = len(text)
            archive.addfile(entry, io.BytesIO(text))


@pytest.mark.parametrize("noise", [1.0, 3.4])
def test_noise_is_found_below_a_slow_change(noise):
    found = white_noise(wandering(np.random.default_rng(0), noise, 19))
    assert np.all(np.abs(found / np.hypot(noise, 0.29) - 1.0) < 0.2)


def test_tables_are_read_from_archives(tmp_path):
    rng = np.random.default_rng(1)
    steady, slips = wandering(rng, 3.4, 24), wandering(rng, 9.0, 24)
    archive = tmp_path / "biotac_sp_slip_direction" / "csvs.tar.gz"
    pack(archive, {"csvs/t/bottle.csv": steady, "csvs/n/bottle.csv": slips})
    assert touching(tmp_path).shape == (1, 24)
    assert np.median(touching(tmp_path)) == pytest.approx(3.4, rel=0.1)
    slide = wandering(rng, 1.0, 45)
    slide[:, -1] = np.abs(rng.standard_normal(300))
    pack(tmp_path / "biotac_slide_iiwa" / "slides_20mat_x4.tar.gz", {"mat1_1_bio.csv": slide})
    assert sliding(tmp_path) == pytest.approx([1.0], rel=0.2)


def test_missing_recordings_are_named(tmp_path):
    with pytest.raises(BadInputError, match="EPFL"):
        measure_all(tmp_path)
