"""Paper A's study of friction: every object and region, every hand calibrated on known blocks."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.friction.subjects import REFERENCES, SUBJECTS
from benchmarks.friction.trials import Case, holds_truth, run_cases
from tactile_dynamics_ros.core.array import Array

FIRST_HAND = 1020
"""The constants below were chosen on hands before it."""
REPEATS, ANGLE_STD, LEVEL_STD = 5, np.deg2rad(0.5), np.deg2rad(0.1)
"""Slope method that tells the coefficients of the reference blocks: repeats for each block, the
scatter of the angle in one of them, and the error of the inclinometer, common to all of a hand."""
GRASP_STD = 0.005
"""By how much the gain of a fingertip differs between two grasps."""
UNIT_STD, PLACE_STD, PLACE_WIDTH = 0.05, 0.01, 0.012
"""Gains differ by no more from fingertip to fingertip, and by so much from place to place of one,
where the widths of what is held differ by that many m."""
TRIALS = 2
"""Reference blocks of each width, with coefficients of their own."""
QUANTILE = 2.2
"""By which `repeatable` exceeds a standard deviation, of some ten slips."""
FORCE_LIMIT = 4.5
PAPER = 0.0056


def run_study(hands: int, processes: int, cache: Path) -> list[dict[str, Any]]:
    """Probe the reference blocks and all subjects with every hand; return the subjects' rows."""
    rows = []
    for hand in range(FIRST_HAND, FIRST_HAND + hands):
        blocks = [Case(block, hand, trial) for trial in range(TRIALS) for block in REFERENCES]
        known = run_cases(blocks, processes, cache)
        cases = []
        for subject in SUBJECTS:
            gain, std = calibrate(known, subject.site().width)
            cases.append(Case(subject, hand, gain=gain, gain_std=std))
        for row, case in zip(run_cases(cases, processes, cache), cases, strict=True):
            exact, _ = calibrate(known, case.subject.site().width, exactly=True)
            rows.append(row | {"gain": case.gain, "exact_gain": exact})
    return rows


def calibrate(
    rows: Sequence[dict[str, Any]], width: float, exactly: bool = False
) -> tuple[float, float]:
    """Gain of a hand's finger and its standard deviation from probes of the reference blocks.

    What is as wide as a block is touched with the same place of the skin: the gain is a Gaussian
    process over the width (m), with mean 1 and covariance

        UNIT_STD^2 + PLACE_STD^2 exp(-(w - w')^2 / (2 PLACE_WIDTH^2)),

    seen by each probe of a block with that probe's scatter, the error of the slope method (what is
    common to all blocks stays) and `GRASP_STD`, which is allowed for the grasp that follows too.

    Args:
        rows: probes of the blocks.
        width: of what is held, m.
        exactly: as if the coefficients of the blocks were known without error.

    Source: Gaussian process regression (Rasmussen and Williams, 2006, eq. 2.23 and 2.24).
    """
    rows = [row for row in rows if "estimate" in row]
    if not rows:
        return 1.0, 0.1
    static = np.array([row["estimate"]["static"] for row in rows])
    scatter = np.array([row["estimate"]["repeatable"] for row in rows]) / QUANTILE / static
    true = np.array([row["true_static"] for row in rows])
    error, noise = (np.zeros(len(true)), np.zeros((len(true), 2))) if exactly else _slope(rows)
    gains = (true + error) / static
    across = {block.name: block.site().width for block in REFERENCES}
    widths = np.array([across[row["subject"]] for row in rows])
    seen = _place_covariance(widths, widths) + np.outer(noise[:, 1], noise[:, 1])
    seen += np.diag(scatter**2 + GRASP_STD**2 + noise[:, 0] ** 2)
    here = _place_covariance(widths, np.array([width]))[:, 0]
    share = np.linalg.solve(seen, here)
    left = UNIT_STD**2 + PLACE_STD**2 - share @ here
    gain = 1.0 + float(share @ (gains - 1.0))
    return gain, float(np.sqrt(left + GRASP_STD**2))


def _slope(rows: Sequence[dict[str, Any]]) -> tuple[Array, Array]:
    """Errors (N,) of the blocks' coefficients, and (N, 2) their relative stds, own and common.

    d mu = (1 + mu^2) d theta, with the mean of `REPEATS` angles.
    """
    hand = rows[0]["hand"]
    true = np.array([row["true_static"] for row in rows])
    own, common = ANGLE_STD / np.sqrt(REPEATS), LEVEL_STD
    seeds = [[hand, 31, zlib.crc32(row["subject"].encode()), row["trial"]] for row in rows]
    angle = own * np.array([np.random.default_rng(seed).standard_normal() for seed in seeds])
    angle += common * np.random.default_rng([hand, 31]).standard_normal()
    steep = 1.0 + true**2
    return steep * angle, np.outer(steep / true, [own, common])


def _place_covariance(a: Array, b: Array) -> Array:
    """Covariance (N, M) of the gains at widths (N,) and (M,), m."""
    apart = (a[:, None] - b) / PLACE_WIDTH
    return np.asarray(UNIT_STD**2 + PLACE_STD**2 * np.exp(-0.5 * apart**2))


def summarise_study(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Numbers of the study, over all subjects and for each."""
    rows = list(rows)
    done = [row for row in rows if "estimate" in row]
    truth = np.array([row["true_static"] for row in done])
    static = np.array([row["estimate"]["static"] for row in done])
    error = truth - static
    bare = static / np.array([row["gain"] for row in done])
    exact = np.array([row["exact_gain"] for row in done])
    inside = [holds_truth(row) for row in done]
    return {
        "probes": len(rows),
        "with_estimate": len(done),
        "median_abs_error": _median(np.abs(error)),
        "median_error": _median(error),
        "median_abs_error_uncalibrated": _median(np.abs(truth - bare)),
        "median_abs_error_blocks_known_exactly": _median(np.abs(truth - exact * bare)),
        "paper_median_error": PAPER,
        "interval_coverage": float(np.mean(inside)) if inside else None,
        "interval_half_width_median": _median(
            [0.5 * (r["estimate"]["interval"][1] - r["estimate"]["interval"][0]) for r in done]
        ),
        "kinetic_median_abs_error": _median(
            [abs(r["estimate"]["kinetic"] - r["true_kinetic"]) for r in done]
        ),
        "normal_moves_said": int(sum(row["estimate"]["normal_moves"] for row in done)),
        "drops": int(sum(row.get("dropped", False) for row in rows)),
        "force_limit_violations": int(sum(r.get("strongest", 0.0) > FORCE_LIMIT for r in rows)),
        "strongest_force_n": float(max((r.get("strongest", 0.0) for r in rows), default=0.0)),
        "longest_probe_s": float(max((r.get("duration", 0.0) for r in rows), default=0.0)),
        "objects": {s.name: _of_subject(s.name, done) for s in SUBJECTS},
    }


def _of_subject(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    own = [row for row in rows if row["subject"] == name]
    errors = [row["true_static"] - row["estimate"]["static"] for row in own]
    return {"probes": len(own), "median_error": _median(errors), "errors": errors}


def _median(values: Any) -> float | None:
    values = np.asarray(values, dtype=float)
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else None
