"""How loud electrodes of real BioTacs are: white noise in published recordings of three sensors.

Usage: python -m benchmarks.biotac_noise [--data ../shared/data] [--json]

White noise is the root mean square of the change from one sample to the next, over the root of two.
It includes the rounding to whole counts (0.29) and whatever moves the skin that fast.
"""

from __future__ import annotations

import argparse
import json
import sys
import tarfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.biotac_real import read_trial
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError

DATA = Path(__file__).parent.parent.parent / "shared" / "data"
_STRETCH = 50
_PRESSURE, _FIRST_ELECTRODE = 3, -19
_LIFTED = 0.04
"""PDC (hundreds of counts) below which nothing touches the finger."""
_FOLDED = 3.0
"""Counts below which an absolute value may have changed its sign on the way."""


def white_noise(counts: Array) -> Array:
    """Return the standard deviation (K,) of white noise in signals (N, K) that change slowly."""
    return np.asarray(np.sqrt(np.mean(np.diff(counts, axis=0) ** 2, axis=0) / 2.0))


def untouched(data: Path) -> Array:
    """White noise of each electrode of a 19-electrode sensor that nothing touches (EPFL)."""
    found = []
    for log in sorted((data / "biotac_contact_normal").glob("*.log")):
        change = read_trial(log).change
        still = np.flatnonzero(change[:, 19] < _LIFTED)
        runs = np.split(still, np.flatnonzero(np.diff(still) > 1) + 1)
        found += [white_noise(100.0 * change[run, :19]) for run in runs if len(run) >= _STRETCH]
    return np.asarray(found)


def sliding(data: Path) -> Array:
    """White noise of a 19-electrode sensor in the quietest half second of every slide (iiwa)."""
    found = []
    for table in _tables(data / "biotac_slide_iiwa" / "slides_20mat_x4.tar.gz", "_bio.csv"):
        starts = range(0, len(table) - _STRETCH, 10)
        start = min(starts, key=lambda k: table[k : k + _STRETCH, _PRESSURE].std())
        electrodes = table[start : start + _STRETCH, _FIRST_ELECTRODE:]
        clear = electrodes.min(axis=0) > _FOLDED
        if clear.any():
            found.append(np.median(white_noise(electrodes[:, clear])))
    return np.asarray(found)


def touching(data: Path) -> Array:
    """White noise of each electrode of a 24-electrode sensor (BioTac SP) in steady touch."""
    archive = data / "biotac_sp_slip_direction" / "csvs.tar.gz"
    return np.array([white_noise(table) for table in _tables(archive, ".csv", "csvs/t/")])


RECORDINGS: dict[str, Callable[[Path], Array]] = {
    "19 electrodes, untouched (EPFL)": untouched,
    "19 electrodes, sliding (iiwa)": sliding,
    "24 electrodes, steady touch (SP)": touching,
}


def _tables(archive: Path, ending: str, folder: str = "") -> Iterator[Array]:
    """Yield the numbers (N, K) of every table in an archive, without headings."""
    with tarfile.open(archive) as files:
        for member in files:
            content = files.extractfile(member)
            if content is not None and folder in member.name and member.name.endswith(ending):
                lines = content.read().decode().splitlines()
                rows = [line.strip(", ") for line in lines if line[:1].isdigit()]
                yield np.array([[float(v) for v in row.split(",")] for row in rows])


def run(data: Path = DATA) -> dict[str, dict[str, float]]:
    """Return the median white noise of every recording, counts, and its 5 and 95 % quantiles.

    Raises:
        BadInputError: a recording is missing.
    """
    found = {}
    for name, measure in RECORDINGS.items():
        try:
            noise = measure(data)
        except OSError as error:
            raise BadInputError(f"{data}: the recordings are not there ({error})") from error
        if noise.size == 0:
            raise BadInputError(f"{data}: nothing usable of '{name}'")
        low, middle, high = np.percentile(noise, [5, 50, 95])
        found[name] = {"counts": float(middle), "low": float(low), "high": float(high)}
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the noise of every recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder with the recordings")
    parser.add_argument("--json", action="store_true", help="print only JSON")
    args = parser.parse_args(arguments)
    try:
        found = run(args.data)
    except BadInputError as error:
        print(error, file=sys.stderr)
        return 2
    if args.json:
        print(json.dumps(found))
    else:
        for name, noise in found.items():
            print(f"{name:34s} {noise['counts']:.2f} ({noise['low']:.2f} to {noise['high']:.2f})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
