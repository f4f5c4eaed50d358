"""Integrals from a boundary alone: circles with holes, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from cgi_wave.kernels.circles import circle_region
from cgi_wave.kernels.enclosed import enclosed
from cgi_wave.kernels.polynomials import affine


def ring(hole: float, centre: tuple[float, float]) -> np.ndarray:
    """Boundary of a disc of radius 1 about ``centre`` with a concentric hole."""
    circles = [(*centre, radius) for radius in (1.0, hole) if radius > 0.0]
    panels = np.empty((64, 2, 16))
    used = circle_region(np.array(circles), np.array([1.0, -1.0][: len(circles)]), panels)
    return panels[:used]


@pytest.mark.parametrize("hole", [0.0, 0.4])
@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.3, -2.5)])
def test_moments_of_a_ring(hole, centre):
    """∫ (x² + 2)(2 − y) and the squares over a ring, wherever the origin lies: outside, or in the hole."""
    x2, y1 = np.zeros((6, 6)), np.zeros((6, 6))
    x2[2, 0], x2[0, 0] = 1.0, 2.0
    y1[0, 1], y1[0, 0] = -1.0, 2.0
    a = affine(x2, -centre[0], -centre[1], 1.0, 0.0, 0.0, 1.0)  # about the ring's centre
    b = affine(y1, -centre[0], -centre[1], 1.0, 0.0, 0.0, 1.0)
    curves = ring(hole, centre)
    none = np.empty((0, 6, 6))
    owner = np.full(len(curves), -2)
    cross, aa, bb, area, edge, rim = enclosed(curves, owner, none, np.empty(0), a, b)
    m0, m2, m4 = (np.pi * (1.0 - hole ** (2 * k)) / k for k in (1, 2, 3))  # ∫ r^(2k−2) dA
    assert area == pytest.approx(m0, rel=1e-12)
    assert cross == pytest.approx(m2 + 4.0 * m0, rel=1e-12)  # ⟨x²⟩ is half of r², y averages out
    assert aa == pytest.approx(0.375 * m4 + 2.0 * m2 + 4.0 * m0, rel=1e-12)
    assert bb == pytest.approx(0.5 * m2 + 4.0 * m0, rel=1e-12)
    assert edge == 0.0
    # (x² + 2)(2 − y) > 0 on both circles; its mean over one is r² + 4
    assert rim == pytest.approx(sum(2.0 * np.pi * r * (r * r + 4.0) for r in (1.0, hole)), rel=1e-12)


def test_strip_that_a_clearance_leaves_open():
    """|∇(1 − r²)| = 2 on the unit circle: a residual of 1e-3 moves it by 5e-4."""
    clear = np.zeros((1, 3, 3))
    clear[0, 0, 0], clear[0, 2, 0], clear[0, 0, 2] = 1.0, -1.0, -1.0
    one = np.zeros((3, 3))
    one[0, 0] = 1.0
    curves = ring(0.0, (0.0, 0.0))
    *_, edge, rim = enclosed(curves, np.zeros(len(curves), np.int64), clear, np.array([1e-3]), one, one)
    assert rim == pytest.approx(2.0 * np.pi, rel=1e-12)
    assert edge == pytest.approx(2.0 * np.pi * 5e-4, rel=1e-12)
