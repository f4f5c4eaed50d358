"""Errors by pairs' own images: against the image made with a pair's own kernel, and their bounds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import correlate
from synthetic_fields import michelson

from cgi_wave.fringes.field import MutualKernel
from cgi_wave.fringes.mutual_error import mutual_error


def kernel(step=1):
    """Fringes under a blur, less their mean times the blur: complex, of sum 0."""
    d = np.arange(-4, 5)
    blur = np.outer(np.hanning(11)[1:-1], np.hanning(11)[1:-1])
    blur = blur / blur.sum()
    fringes = blur * np.exp(2j * np.pi * d[:, None] / 5.0)
    return MutualKernel(fringes - fringes.sum() * blur, step, 1.0)


def with_kernels(*kernels):
    """The synthetic field with a kernel for the nominal pair and each of three others."""
    field = michelson()
    return replace(field, pairs=tuple(replace(p, mutual=k) for p, k in zip(field.pairs, (None, *kernels), strict=True)))


def test_it_is_the_difference_of_two_images():
    rng = np.random.default_rng(4)
    image = rng.random((60, 70))
    field = with_kernels(kernel(), replace(kernel(), apart=0.0 * kernel().apart, most=0.0), replace(kernel(), most=0.0))
    measured, bounded = mutual_error(field, image)
    full = sum(
        correlate(image, part, mode="nearest") ** 2 for part in (kernel().apart.real, kernel().apart.imag)
    )  # no side of an odd kernel is nearer than the other
    strength = 2.0 * field.strength(field.pairs[1]).max()
    assert measured == pytest.approx(strength * np.sqrt(full.max()), rel=1e-9)
    assert bounded == pytest.approx(strength * 0.5 * np.ptp(image) * (1.0 - np.abs(kernel().apart).sum()), rel=1e-9)


def test_a_uniform_scene_has_none_and_kernels_not_known_are_bounded():
    flat, field = np.full((40, 40), 0.6), with_kernels(kernel(), None, None)
    assert mutual_error(field, flat) == (0.0, 0.0)
    image = np.zeros((40, 40))
    image[20:] = 2.0
    _, bounded = mutual_error(with_kernels(None, None, None), image)
    field = michelson()
    assert bounded == pytest.approx(
        sum(2.0 * field.strength(p).max() * (1.0 + np.abs(p.gamma).max()) for p in field.pairs[1:])
    )


def test_wide_kernels_are_tried_on_means_over_cells():
    """A scene of blocks seen by cells of their size: the same as the small scene with the small kernel."""
    small = np.random.default_rng(5).random((50, 40))
    none = replace(kernel(), apart=0.0 * kernel().apart, most=0.0)
    fine = mutual_error(with_kernels(kernel(), none, none), small)
    coarse = mutual_error(with_kernels(kernel(3), none, none), np.kron(small, np.ones((3, 3))))
    assert coarse == pytest.approx(fine, rel=1e-12)
