"""Coherencies whose interferograms have closed forms, and the slow oracle of the spectral sum."""

from __future__ import annotations

import numpy as np

from cgi_wave.fringes.coherency import Coherency, LeftOut, LeftOutPairs, Pair

SIGMA0 = 1.0 / 0.764e-6
PERIOD = 0.675e-3  # fringe period on the detector, m
SLOPE = 1.0 / (SIGMA0 * PERIOD)
PITCH = 15e-6
ROWS = (np.arange(450) - 224.5) * PITCH


def pair(m, l, gamma, opd, slope=0.0, sigma=None, error=0.0):  # noqa: E741
    """A pair with constant γ and OPD, achromatic unless given nodes."""
    nodes = np.array([SIGMA0]) if sigma is None else sigma
    one = np.ones(len(nodes))
    return Pair(m, l, nodes, gamma * one.astype(complex), error * one, opd * one, slope, "closed form")


def coherency(transmission, family, pairs, left_out=()):
    family = np.array(family)
    labels = tuple(f"beam {i}" for i in range(len(family)))
    t = np.array(transmission, dtype=float)
    return Coherency(labels, family, (family > 0).astype(int), t, tuple(pairs), LeftOutPairs.of(left_out))


def lossless_splitter(reflectance=0.5):
    """t, r, r′ with t r* + t* r′ = 0: r = i√R on one side and r′ = −t r*/t* on the other."""
    t, r = np.sqrt(1.0 - reflectance) + 0j, 1j * np.sqrt(reflectance)
    return t, r, -t * np.conj(r) / np.conj(t)


def amplitudes(reflectance=0.5, wrong_phase=False):
    """Amplitudes of arms 1 and 2: entrance → detector port, and detector port → the same port."""
    t, r, r_back = lossless_splitter(reflectance)
    to_detector = np.array([t * r_back, r * t])
    back = np.array([r_back * r_back * (-1.0 if wrong_phase else 1.0), t * t])
    return to_detector, back


def retro_family(opd, power, shear=1.0, wrong_phase=False, reflectance=0.5, slope=SLOPE):
    """Nominals and the family of a reflector behind the interferometer, arm pairs (1,1), (1,2), (2,1), (2,2).

    ``power``: reflectance times filter passes. ``shear``: mean over the pupil of exp(i·phase between the two visits to
    the mirrors), by which the first visit's fringes are washed out. Ghost–nominal pairs are left out (a metre apart).
    """
    forward, back = amplitudes(reflectance, wrong_phase)
    arms = [(a, b) for a in (0, 1) for b in (0, 1)]
    field = [forward[0], forward[1]] + [np.sqrt(power) * forward[a] * back[b] for a, b in arms]
    turns = [(0, 0), (1, 0)] + [(a, b) for a, b in arms]  # (first visit, second visit) by arm 2; nominals: one visit
    pairs = [pair(0, 1, np.exp(1j * np.angle(field[0] * np.conj(field[1]))), opd, slope)]
    for i in range(2, 6):
        for j in range(i + 1, 6):
            first, second = turns[j][0] - turns[i][0], turns[j][1] - turns[i][1]
            order = first + second  # OPD of arm 1 minus arm 2 counts +opd per arm changed
            washed = shear if first == 1 else np.conj(shear) if first == -1 else 1.0
            gamma = np.exp(1j * np.angle(field[i] * np.conj(field[j]))) * washed
            pairs.append(pair(i, j, gamma, order * opd, order * slope))
    out = [LeftOut(n, g, 0.0, "a metre apart") for n in (0, 1) for g in range(2, 6)]
    return coherency(np.abs(field) ** 2, [0, 0, 1, 1, 1, 1], pairs, out)


def direct_sum(coh, sigma, weight, y, row_height, selected):
    """Eq. 2 term by term in float64: every σ, pair and row, on the full grid."""
    step = np.diff(sigma)
    w = 0.5 * (np.append(step, 0.0) + np.append(0.0, step)) * weight
    w = w / w.sum()
    total = np.zeros(len(y))
    for p in coh.pairs:
        if not selected(p):
            continue
        degree = len(p.sigma) - 1
        centre, half = 0.5 * (p.sigma[0] + p.sigma[-1]), 0.5 * np.ptp(p.sigma)
        x, xs = (p.sigma - centre) / half, (sigma - centre) / half
        gamma = np.polynomial.chebyshev.chebval(xs, np.polynomial.chebyshev.chebfit(x, p.gamma, degree))
        opd = np.polynomial.chebyshev.chebval(xs, np.polynomial.chebyshev.chebfit(x, p.opd_m, degree))
        amplitude = 2.0 * np.sqrt(coh.transmission[p.m] * coh.transmission[p.l])
        for i, yi in enumerate(y):
            phase = np.exp(2j * np.pi * sigma * (opd + p.slope * yi)) * np.sinc(sigma * p.slope * row_height)
            total[i] += amplitude * np.real(np.sum(w * gamma * phase))
    return total
