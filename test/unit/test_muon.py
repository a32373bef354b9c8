"""Muon: steps of one size in all directions, momentum and decay."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from tactile_dynamics_ros.core.tactile.network.training import Muon, orthogonalise


@pytest.mark.parametrize("shape", [(48, 48), (64, 20), (20, 64)])
def test_orthogonalised_matrix_keeps_its_directions_and_loses_its_scales(shape):
    torch.manual_seed(0)
    left, _, right = torch.linalg.svd(torch.randn(*shape), full_matrices=False)
    scales = torch.linspace(1.0, 0.1, min(shape))
    found = left.T @ orthogonalise(left @ torch.diag(scales) @ right) @ right.T
    assert found.diagonal().min() > 0.6 and found.diagonal().max() < 1.25
    assert (found - torch.diag(found.diagonal())).abs().max() < 1e-3


def test_step_has_the_size_asked_for_whatever_the_gradient():
    for scale in (1e-4, 1.0, 1e4):
        matrix = nn.Parameter(torch.zeros(12, 3))
        matrix.grad = scale * torch.eye(12, 3)
        Muon([matrix], lr=0.1).step()
        step = -matrix.detach()[:3] / (0.1 * (12 / 3) ** 0.5)
        assert (step.diagonal() > 0.6).all() and (step.diagonal() < 1.25).all()


def test_weights_decay_and_momentum_outlives_a_gradient():
    matrix = nn.Parameter(torch.full((2, 2), 3.0))
    optimiser = Muon([matrix], lr=0.1, weight_decay=0.5)
    matrix.grad = torch.eye(2)
    optimiser.step()
    assert torch.allclose(matrix.detach()[0, 1], torch.tensor(0.95 * 3.0), atol=0.02)
    before = matrix.detach().clone()
    matrix.grad = torch.zeros(2, 2)
    optimiser.step()
    assert (matrix.detach() - 0.95 * before).diagonal().max() < -0.05
