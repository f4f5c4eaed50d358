"""Layers and scenes for the scroll: known patterns, views and blurs, and frames computed pixel by pixel."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from cgi_wave.fringes.field import SceneView
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.pattern import Layer

PITCH = 15e-6
SHARP = np.ones((1, 1))
NO_ERRORS = dict.fromkeys([field.name for field in fields(Layer)][3:], 0.0)


def zone(rows=40, columns=24, row=0.0, column=0.0, period=None, tilt=0.0):
    """A zone about the detector's middle; with a period (rows) its nominal phase, fringes tilted by rows per column."""
    y, x = ((np.arange(n) - 0.5 * (n - 1)) * PITCH for n in (rows, columns))
    phase = None
    if period is not None:
        phase = 2.0 * np.pi * (y[:, None] + tilt * x[None, :]) / (period * PITCH) + 0.4
    return Zone(x, y, row, column, phase)


def layer(pattern, affine=None, kernel=SHARP, name="ghost"):
    """A layer of one mode (R, X) or several (C, R, X); without an affine map the nominal one."""
    pattern = np.asarray(pattern, dtype=np.float64)
    pattern = pattern[None] if pattern.ndim == 2 else pattern
    if affine is None and kernel is SHARP:
        return Layer("nominal", pattern, None, **NO_ERRORS)
    affine = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) if affine is None else np.asarray(affine, dtype=float)
    return Layer(name, pattern, SceneView(1, name, affine, kernel, 0.0), **NO_ERRORS)


def gaussian(sigma, reach=4.0):
    """Gaussian kernel, sigma in pixels."""
    half = int(np.ceil(reach * sigma))
    line = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    line /= line.sum()
    return np.outer(line, line)


def scene(height, width, seed=3, modes=1):
    return np.random.default_rng(seed).random((modes, height, width))


def fringes(z, mean=0.5, visibility=0.4):
    return mean * (1.0 + visibility * np.cos(z.phase))


def slow_image(image, z, affine, kernel, shift, wrap=False):
    """Image (R, X) of one map by the definition: bilinear between samples, the kernel summed offset by offset."""
    rows, columns = z.shape
    height, width = image.shape
    out = np.zeros((rows, columns))
    half = np.array(kernel.shape) // 2
    for j in range(rows):
        for i in range(columns):
            place = affine @ np.array([z.x_m[i], z.y_m[j], 1.0])
            u = z.column + (place[0] - z.x_m[0]) / PITCH
            v = z.row + (place[1] - z.y_m[0]) / PITCH + shift
            for a in range(kernel.shape[0]):
                for b in range(kernel.shape[1]):
                    r, c = v + a - half[0], u + b - half[1]
                    r0, c0 = int(np.floor(r + 1e-9)), int(np.floor(c + 1e-9))
                    total = 0.0
                    for dr, wr in ((0, 1.0 - (r - r0)), (1, r - r0)):
                        for dc, wc in ((0, 1.0 - (c - c0)), (1, c - c0)):
                            row = (r0 + dr) % height if wrap else min(max(r0 + dr, 0), height - 1)
                            total += wr * wc * image[row, min(max(c0 + dc, 0), width - 1)]
                    out[j, i] += kernel[a, b] * total
    return out
