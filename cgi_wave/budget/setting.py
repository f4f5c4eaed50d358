"""What all field points of one band share: the optics, the light behind the filter, and how coherent it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError
from cgi_wave.optics.system import NM, OpticalSystem
from cgi_wave.scene.coherence import coherence, coherence_envelope
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.radiance import toa_radiance
from cgi_wave.scene.spectrum import Spectrum
from cgi_wave.scene.spectrum_file import load_spectrum

Array = NDArray[np.float64]

#: OPD up to which spectra are sampled and pairs computed, m. Beyond, the envelope is bounded instead.
MAX_OPD = 0.1
#: A spectrum from a file has to resolve this many times the OPD that the band is made for.
FILE_OPD = 3.0


@dataclass(frozen=True)
class Setting:
    """One band.

    weight (S,): radiance times filter at the spectrum's wavenumbers, any unit; support (1/m): where the filter passes;
    envelope(opd_lo, opd_hi): largest coherence of the filtered light over a range of OPDs (m), arrays broadcast;
    nma: of two equal beams at the OPD that the band is made for.
    """

    system: OpticalSystem
    spectrum: Spectrum
    weight: Array
    support: tuple[float, float]
    envelope: Callable[..., Array]
    nma: float


def band_setting(system: OpticalSystem) -> Setting:
    """Spectrum, filter and coherence of a band. Raises InputError."""
    spectrum, band_filter = band_spectrum(system)
    target = np.array([system.spec.target_opd_mm * 1e-3])
    return Setting(
        system, spectrum, spectrum.radiance * band_filter.transmission(spectrum.sigma), band_filter.support(),
        coherence_envelope(spectrum, band_filter), float(abs(coherence(spectrum, band_filter, target)[0])),
    )  # fmt: skip


def filter_of(system: OpticalSystem) -> Filter:
    """The band's filter. Raises InputError."""
    declared = system.spec.filter
    return Filter(declared.centre_nm * NM, declared.fwhm_nm * NM, declared.shape)


def band_spectrum(system: OpticalSystem, max_opd: float = MAX_OPD) -> tuple[Spectrum, Filter]:
    """Radiance and filter of a band as its instrument file declares them.

    A spectrum file is sought beside the instrument file. It has to carry FILE_OPD times the band's own OPD; beyond, it
    is taken as drawn straight between its samples. Raises InputError.
    """
    spec = system.spec
    band_filter = filter_of(system)
    if spec.spectrum.kind == "file":
        if spec.spectrum.file is None:
            field = f"band.{system.band}.spectrum.file"
            raise InputError(system.file, field, None, "is missing for kind = 'file'", "name a CSV or NetCDF file")
        file = Path(system.file).parent / spec.spectrum.file
        read = load_spectrum(file, band_filter, FILE_OPD * spec.target_opd_mm * 1e-3)
        count = 1 + int(np.ceil(4.0 * max_opd * (read.sigma[-1] - read.sigma[0])))
        if count <= len(read.sigma):
            return read, band_filter
        fine = np.linspace(read.sigma[0], read.sigma[-1], count)
        return Spectrum(
            fine, np.interp(fine, read.sigma, read.radiance), f"{read.source}; straight between"
        ), band_filter
    radiance = toa_radiance(
        spec.spectrum.kind, band_filter, max_opd, albedo=spec.spectrum.albedo, air_mass=spec.spectrum.air_mass
    )
    return radiance, band_filter
