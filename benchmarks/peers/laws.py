"""Peers of learnt laws on the same residuals: sparse regression, a network, symbolic regression.

Each learns what the rigid body leaves of one recording, as a function of place, velocity, rate of
turn and time, and predicts it on a second one, where the body is fitted again beside it. PySINDy
and gplearn are found if they are installed anywhere on PYTHONPATH, else left out.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.discrepancy.screening import orthonormal
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import noise_floor
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel

Predict = Callable[[np.ndarray], np.ndarray]
_EVERY = 4
"""Samples of which one is learnt from: 25 Hz of 100, as fast as any law here but a motor's."""


def compare_peers(first: HeldObjectModel, second: HeldObjectModel, seed: int) -> dict[str, Any]:
    """Error over the floor on a second recording, size and CPU seconds, by name of the peer.

    Args:
        first: fitted without the law, to the recording that is learnt from.
        second: the same of another recording.
        seed: of random starts.
    """
    inputs, turn, target = _tables(first)
    scale = inputs.std(axis=0) + 1e-9
    middle = inputs.mean(axis=0)
    found: dict[str, Any] = {}
    for name, learn in (("pysindy", _sindy), ("network", _network), ("gplearn", _symbolic)):
        started = time.process_time()
        try:
            predict, size = learn((inputs[::_EVERY] - middle) / scale, target[::_EVERY], seed)
        except ImportError:
            continue
        there, turned, _ = _tables(second)
        wrench = predict((there - middle) / scale)
        wrench[:, 3:] = np.einsum("nji,nj->ni", turned, wrench[:, 3:])
        found[name] = {
            "second_after": _error(second, wrench), "size": size,
            "cpu_s": time.process_time() - started,
        }  # fmt: skip
    return found


def _tables(model: HeldObjectModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quantities (N, 10), orientations (N, 3, 3), lacking torque (body) and force (world axes)."""
    samples = model.samples
    spin = np.einsum("nij,nj->ni", samples.rotation, samples.angular_velocity)
    inputs = np.column_stack([samples.position, samples.velocity, spin, samples.time])
    factors = model.residuals().factors
    assert factors is not None
    white = factors[0]  # of the same sign as `smooth` once its noise is averaged out
    smooth = model.residuals().physical
    target = smooth * np.sign(np.sum(smooth * white))
    target[:, 3:] = np.einsum("nij,nj->ni", samples.rotation, target[:, 3:])
    return inputs, samples.rotation, target


def _error(model: HeldObjectModel, wrench: np.ndarray) -> float:
    """White RMS over its floor with a wrench subtracted, the body fitted again."""
    left = model.residual - model.whitening.whiten([wrench[:, :, None]])[:, 0]
    basis = orthonormal(model.jacobian)
    left = left - basis @ (basis.T @ left)
    return float(np.sqrt(np.mean(left**2)) / noise_floor(model))


def _sindy(inputs: np.ndarray, target: np.ndarray, seed: int) -> tuple[Predict, int]:
    """Sparse square polynomials by sequentially thresholded least squares (PySINDy).

    The threshold is that which predicts the second half best from the first.
    """
    import pysindy

    library = pysindy.PolynomialLibrary(degree=2)
    columns = np.asarray(library.fit_transform(inputs))
    units = target.std(axis=0)
    wanted, half = target / units, len(target) // 2

    def fitted(threshold: float, rows: slice) -> np.ndarray:
        fit = pysindy.STLSQ(threshold=threshold, alpha=1.0).fit(columns[rows], wanted[rows])
        return np.asarray(fit.coef_)

    def lost(threshold: float) -> float:
        left = wanted[half:] - columns[half:] @ fitted(threshold, slice(half)).T
        return float(np.sum(left**2))

    coefficients = fitted(min((0.02, 0.05, 0.1, 0.2, 0.5), key=lost), slice(None))

    def predict(there: np.ndarray) -> np.ndarray:
        return np.asarray(library.transform(there)) @ coefficients.T * units

    return predict, int(np.count_nonzero(coefficients))


def _network(inputs: np.ndarray, target: np.ndarray, seed: int) -> tuple[Predict, int]:
    """Two layers of 32 units."""
    import torch

    torch.manual_seed(seed)
    units = target.std(axis=0)
    net = torch.nn.Sequential(
        torch.nn.Linear(inputs.shape[1], 32), torch.nn.Tanh(), torch.nn.Linear(32, 32),
        torch.nn.Tanh(), torch.nn.Linear(32, target.shape[1]),
    )  # fmt: skip
    x, y = (torch.tensor(a, dtype=torch.float32) for a in (inputs, target / units))
    search = torch.optim.Adam(net.parameters(), 1e-2, weight_decay=1e-4)
    for _ in range(500):
        search.zero_grad()
        torch.mean((net(x) - y) ** 2).backward()
        search.step()

    def predict(there: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return net(torch.tensor(there, dtype=torch.float32)).numpy().astype(float) * units

    return predict, sum(p.numel() for p in net.parameters())


def _symbolic(inputs: np.ndarray, target: np.ndarray, seed: int) -> tuple[Predict, int]:
    """A formula for each of the six channels by genetic programming (gplearn)."""
    from gplearn.genetic import SymbolicRegressor

    units = target.std(axis=0)
    functions = ("add", "sub", "mul", "div", "sqrt", "abs")
    fits = [
        SymbolicRegressor(
            population_size=300, generations=8, function_set=functions, random_state=seed
        ).fit(inputs, column)
        for column in (target / units).T
    ]

    def predict(there: np.ndarray) -> np.ndarray:
        return np.stack([fit.predict(there) for fit in fits], axis=1) * units

    return predict, sum(fit._program.length_ for fit in fits)
