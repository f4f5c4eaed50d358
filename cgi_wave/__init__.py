"""Ghosts, pupil fields, overlap contrast and interferograms of imaging static Fourier-transform spectrometers."""

__version__ = "0.1.0"
