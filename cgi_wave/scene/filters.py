"""Bandpass filters as the detector sees them (in-cone transmission)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.scene.spectrum import Spectrum

Shape = Literal["gaussian", "flat-top", "tabulated"]
EDGE = 1e-6  # the support ends where the transmission has fallen to this fraction of the peak
_POWER = {"gaussian": 2, "flat-top": 4}


@dataclass(frozen=True)
class Filter:
    """A bandpass filter. Its shape is a function of the vacuum **wavelength**, as makers quote it.

    Widths are in-cone widths: those of the light that reaches the detector, already averaged over the converging cone.

    centre_m, fwhm_m : centre and full width at half maximum, m
    shape : ``"gaussian"``, exp[−ln 2·u²] with u = 2(λ − centre)/FWHM; ``"flat-top"``, exp[−ln 2·u⁴], the flatter shape
        with steeper flanks of a filter of several cavities; or ``"tabulated"``
    peak : transmission at the top, 0 < peak ≤ 1; for a tabulated filter the factor on the table
    table : ((wavelength_m, transmission), …) ascending, linear in between, zero outside; only if tabulated

    Raises InputError if a number cannot be that of a filter.
    """

    centre_m: float
    fwhm_m: float
    shape: Shape = "gaussian"
    peak: float = 1.0
    table: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        def refuse(field: str, value: object, problem: str, remedy: str) -> InputError:
            return InputError("filter", field, value, problem, remedy)

        if not (np.isfinite(self.centre_m) and self.centre_m > 0):
            raise refuse("centre_m", self.centre_m, "not a wavelength", "give a positive length in metres")
        if not (0 < self.fwhm_m < 0.4 * self.centre_m):
            raise refuse("fwhm_m", self.fwhm_m, "not a bandpass", "give 0 < FWHM < 0.4 of the centre, in metres")
        if not 0 < self.peak <= 1:
            raise refuse("peak", self.peak, "not a transmission", "give 0 < peak ≤ 1")
        if self.shape not in ("tabulated", *_POWER):
            raise refuse("shape", self.shape, "unknown shape", "use 'gaussian', 'flat-top' or 'tabulated'")
        if self.shape == "tabulated":
            table = np.array(self.table, dtype=np.float64)
            if table.ndim != 2 or table.shape[0] < 2 or table.shape[1] != 2:
                raise refuse("table", self.table, "needs two rows or more", "give (wavelength_m, transmission) rows")
            if not (np.all(np.isfinite(table)) and table[0, 0] > 0 and np.all(np.diff(table[:, 0]) > 0)):
                raise refuse("table", "wavelengths", "not finite, positive, ascending", "sort the rows by wavelength")
            if table[:, 1].min() < 0 or table[:, 1].max() > 1 or table[:, 1].max() == 0:
                raise refuse("table", "transmissions", "outside 0…1 or all zero", "give transmissions in 0…1")
        elif self.table:
            raise refuse("table", "…", "given for a filter that is not tabulated", "drop it or set shape = 'tabulated'")

    @classmethod
    def tabulated(cls, wavelength_m: NDArray[np.float64], transmission: NDArray[np.float64]) -> Filter:
        """A filter from (N,) ascending vacuum wavelengths in m and (N,) transmissions; centre and FWHM are measured."""
        rows = tuple((float(w), float(t)) for w, t in zip(wavelength_m, transmission, strict=True))
        fine = np.linspace(rows[0][0], rows[-1][0], 20 * len(rows) + 1)
        above = fine[np.interp(fine, *np.array(rows).T) >= 0.5 * max(t for _, t in rows)]
        return cls(
            centre_m=float((above[0] + above[-1]) / 2),
            fwhm_m=float(above[-1] - above[0]),
            shape="tabulated",
            table=rows,
        )

    def transmission(self, sigma: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transmission at vacuum wavenumbers ``sigma`` in 1/m, same shape."""
        wavelength = 1 / np.asarray(sigma, dtype=np.float64)
        if self.shape == "tabulated":
            x, y = np.array(self.table).T
            shape: NDArray[np.float64] = np.interp(wavelength, x, y, left=0.0, right=0.0)
        else:
            offset = 2 * np.abs(wavelength - self.centre_m) / self.fwhm_m
            shape = np.exp(-np.log(2) * offset ** _POWER[self.shape])
        return self.peak * shape

    def support(self) -> tuple[float, float]:
        """(sigma_min, sigma_max) in 1/m outside which the transmission is below 1e-6 of the peak."""
        if self.shape == "tabulated":
            x, y = np.array(self.table).T
            used = np.flatnonzero(y > EDGE * y.max())
            first, last = max(used[0] - 1, 0), min(used[-1] + 1, x.size - 1)
            return float(1 / x[last]), float(1 / x[first])
        reach = self.fwhm_m / 2 * (-np.log(EDGE) / np.log(2)) ** (1 / _POWER[self.shape])
        return float(1 / (self.centre_m + reach)), float(1 / (self.centre_m - reach))


def require_coverage(spectrum: Spectrum, band_filter: Filter) -> None:
    """Raise InputError, naming the missing wavelengths, unless ``spectrum`` covers the filter's support.

    One step of the spectrum's grid may be missing at either end.
    """
    low, high = band_filter.support()
    step = spectrum.sigma[1] - spectrum.sigma[0]
    missing = []
    if spectrum.sigma[-1] < high - step:
        missing.append(f"{1e9 / high:.3f}–{min(1e9 / spectrum.sigma[-1], 1e9 / low):.3f} nm")
    if spectrum.sigma[0] > low + step:
        missing.append(f"{max(1e9 / spectrum.sigma[0], 1e9 / high):.3f}–{1e9 / low:.3f} nm")
    if missing:
        have = f"{1e9 / spectrum.sigma[-1]:.3f}–{1e9 / spectrum.sigma[0]:.3f} nm"
        name = f"{band_filter.centre_m * 1e9:g}/{band_filter.fwhm_m * 1e9:g} nm"
        raise InputError(
            spectrum.source,
            "wavelength range",
            have,
            f"does not cover the {name} filter: {' and '.join(missing)} missing",
            f"give a spectrum over {1e9 / high:.3f}–{1e9 / low:.3f} nm",
        )
