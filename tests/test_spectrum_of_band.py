"""A user's own spectrum feeds the chain: the file is sought beside the instrument file."""

import copy

import numpy as np
import pytest

from cgi_wave.budget.setting import band_setting, band_spectrum
from cgi_wave.errors import InputError
from cgi_wave.optics.system import from_document, load_instrument


def instrument(folder, spectrum):
    raw = copy.deepcopy(load_instrument().raw)
    raw["band"]["VIS"]["spectrum"] = spectrum
    return from_document(raw, str(folder / "mine.toml")).band("VIS")


def test_a_flat_spectrum_leaves_the_filter_alone(tmp_path):
    """Equal radiance per wavenumber: the NMA is the Fourier transform of the filter, 0.42 at 20 µm (closed form)."""
    nm = np.linspace(430.0, 470.0, 4001)
    rows = "\n".join(f"{w:.6f},{1e6 / w**2:.9f}" for w in nm)  # per nm, so that it is flat per wavenumber
    (tmp_path / "flat.csv").write_text("wavelength_nm,radiance_W_m2_sr_nm\n" + rows + "\n")
    setting = band_setting(instrument(tmp_path, {"kind": "file", "file": "flat.csv"}))
    width = 5e-9 / 450e-9**2
    assert setting.nma == pytest.approx(np.exp(-((np.pi * width * 20e-6) ** 2) / (4 * np.log(2))), rel=5e-3)


def test_a_missing_file_is_refused_by_its_field(tmp_path):
    with pytest.raises(InputError, match=r"mine\.toml: band\.VIS\.spectrum\.file"):
        band_spectrum(instrument(tmp_path, {"kind": "file"}))
    with pytest.raises(InputError, match=r"none\.csv"):
        band_spectrum(instrument(tmp_path, {"kind": "file", "file": "none.csv"}))
