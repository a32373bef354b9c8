"""Muon: gradient steps whose matrices have been made orthogonal."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import Tensor, nn

_QUINTIC = (3.4445, -4.7750, 2.0315)
"""Coefficients of an odd polynomial that, applied five times, takes (0.02, 1] near one. Source:
Jordan et al., 2024. Other coefficients leave singular values farther from one or need more rounds,
which makes the steps of training unequal."""


class Muon(torch.optim.Optimizer):
    """Steps of equal size along all singular directions of the momentum of each matrix.

    M <- mu M + (1 - mu) G, W <- (1 - lr decay) W - lr sqrt(max(1, rows / columns)) orth(N), where
    N = mu M + (1 - mu) G and orth(U S V^T) is about U V^T. In single precision: the optimiser of
    this name in torch works in bfloat16, some thirty times slower on processors without it.

    Args:
        matrices: parameters of two dimensions.
        lr: size of a step, in the spectral norm.
        momentum: mu. weight_decay: decay.

    Source: Jordan et al., 2024 (Muon); Newton-Schulz iteration after Bernstein and Newhouse, 2024.
    """

    def __init__(
        self,
        matrices: Iterable[nn.Parameter],
        lr: float = 0.02,
        momentum: float = 0.95,
        weight_decay: float = 0.0,
    ) -> None:
        super().__init__(matrices, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """Move every matrix by one step; ``closure`` is not used."""
        for group in self.param_groups:
            for matrix in group["params"]:
                state = self.state[matrix]
                if not state:
                    state["mean"] = torch.zeros_like(matrix)
                state["mean"].lerp_(matrix.grad, 1.0 - group["momentum"])
                ahead = matrix.grad.lerp(state["mean"], group["momentum"])
                stretch = max(1.0, matrix.shape[0] / matrix.shape[1]) ** 0.5
                matrix.mul_(1.0 - group["lr"] * group["weight_decay"])
                matrix.sub_(orthogonalise(ahead), alpha=group["lr"] * stretch)


def orthogonalise(matrix: Tensor, iterations: int = 5) -> Tensor:
    """Return about U V^T (n, m) of a matrix U S V^T (n, m), singular values between 0.7 and 1.2.

    X <- a X + (b X X^T + c (X X^T)^2) X from X = matrix / |matrix|_F.

    Args:
        matrix: (n, m), not zero.
        iterations: enough for singular values above 1 / 50 of the norm.
    """
    a, b, c = _QUINTIC
    tall = matrix.shape[0] > matrix.shape[1]
    found: Tensor = matrix.T if tall else matrix
    found = found / (found.norm() + 1e-7)
    for _ in range(iterations):
        square = found @ found.T
        found = a * found + (b * square + c * square @ square) @ found
    return found.T if tall else found
