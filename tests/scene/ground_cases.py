"""Canvases and a gas line for the tests of scenes."""

import numpy as np

from cgi_wave.scene.filters import Filter
from cgi_wave.scene.ground import Canvas
from cgi_wave.scene.radiance import toa_radiance
from cgi_wave.scene.spectrum import Spectrum

NIR = Filter(764e-9, 2.6e-9, "flat-top")


def canvas(spectrum=None, albedo=0.3, pixel_m=15e-6, ground_pixel_m=75.0):
    spectrum = toa_radiance("solar", NIR, 1e-4, albedo=albedo) if spectrum is None else spectrum
    return Canvas(spectrum, albedo, pixel_m, ground_pixel_m)


def flat(samples=11):
    """A spectrum of 1 over the NIR filter's support."""
    low, high = NIR.support()
    return Spectrum(np.linspace(low, high, samples), np.ones(samples), "flat")
