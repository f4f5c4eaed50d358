"""Spectra, filters and radiance."""
