"""Spectrum files: units, the Jacobian, resampling, refusals."""

from __future__ import annotations

import numpy as np
import pytest
import xarray

from cgi_wave.errors import InputError
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.spectrum_file import load_spectrum


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_integral_is_the_same_per_wavelength_and_per_wavenumber(tmp_path):
    """∫L_λ dλ = ∫L_σ dσ: a triangle of 1 W m⁻² sr⁻¹ nm⁻¹ at the top and 2 nm of area."""
    wavelength = np.linspace(760, 768, 801)
    radiance = np.clip(1 - np.abs(wavelength - 764) / 2, 0, None)
    rows = "\n".join(f"{x:.6f},{y:.9g}" for x, y in zip(wavelength, radiance, strict=True))
    spectrum = load_spectrum(write(tmp_path / "a.csv", f"# lamp\nwavelength_nm,radiance_W_m2_sr_nm\n{rows}\n"))
    step = np.diff(spectrum.sigma)
    assert np.ptp(step) < 1e-6 * step[0]
    assert np.sum(spectrum.radiance) * step[0] == pytest.approx(2.0, rel=1e-4)
    top = spectrum.sigma[np.argmax(spectrum.radiance)]
    assert 1 / top == pytest.approx(764e-9, abs=1e-11)
    assert "resampled" in spectrum.source


@pytest.mark.parametrize(
    ("header", "x", "y"),
    [
        ("wavelength_um,radiance_W_m2_sr_um", 0.764, 1000.0),
        ("wavelength_nm,radiance_W_m2_sr_nm", 764.0, 1.0),
        ("radiance_W_m2_sr_m,other,wavelength_m", 764e-9, 1e9),
        ("wavenumber_cm-1,radiance_W_m2_sr_cm-1", 1e-2 / 764e-9, 1e9 * 764e-9**2 * 100),
        ("wavenumber_m-1,radiance_W_m2_sr_nm", 1 / 764e-9, 1.0),
    ],
)
def test_every_unit_means_the_same_radiance(tmp_path, header, x, y):
    columns = header.split(",")
    lines = [header]
    for scale in (1.001, 1.0, 0.999):  # descending, so that the order is put right on the way
        lines.append(",".join(f"{x * scale:.15g}" if c.startswith("wave") else f"{y:.15g}" for c in columns))
    spectrum = load_spectrum(write(tmp_path / "a.csv", "\n".join(lines)))
    assert np.interp(1 / 764e-9, spectrum.sigma, spectrum.radiance) == pytest.approx(1e9 * 764e-9**2, rel=1e-4)


@pytest.mark.parametrize(
    ("units", "scale"),
    [
        ("W m-2 sr-1 nm-1", 1.0),
        ("W/m^2/sr/um", 1e3),
        ("W m**-2 sr**-1 m**-1", 1e9),
        ("W/(m2 sr nm)", 1.0),
        ("W m-2 sr-1 (cm-1)-1", 1e9 * 764e-9**2 * 100),
        ("W m-2 sr-1 (m-1)-1", 1e9 * 764e-9**2),
    ],
)
def test_netcdf_units_mean_the_same_radiance(tmp_path, units, scale):
    data = xarray.Dataset(
        {
            "wavelength": ("x", [763.9, 764.0, 764.1], {"units": "nm"}),
            "radiance": ("x", np.full(3, scale), {"units": units}),
        }
    )
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    spectrum = load_spectrum(tmp_path / "a.nc")
    assert np.interp(1 / 764e-9, spectrum.sigma, spectrum.radiance) == pytest.approx(1e9 * 764e-9**2, rel=1e-6)


def test_uniform_grid_is_kept_as_it_is(tmp_path):
    sigma = np.linspace(13000.0, 13001.0, 11)
    rows = "\n".join(f"{x:.3f},{1 + i}" for i, x in enumerate(sigma))
    spectrum = load_spectrum(write(tmp_path / "a.csv", f"wavenumber_cm-1,radiance_W_m2_sr_m-1\n{rows}"))
    assert spectrum.sigma == pytest.approx(100 * sigma, rel=1e-12)
    assert spectrum.radiance == pytest.approx(1 + np.arange(11), rel=1e-12)


def test_resampling_error_is_the_one_stated(tmp_path):
    """Spikes between unevenly spaced points: at the file's own points the new grid keeps to 1e-4 of the maximum."""
    rng = np.random.default_rng(3)
    sigma = 13000 + np.cumsum(rng.uniform(0.01, 0.1, 300))
    radiance = rng.uniform(0, 1, 300)
    rows = "\n".join(f"{x:.9f},{y:.9f}" for x, y in zip(sigma, radiance, strict=True))
    spectrum = load_spectrum(write(tmp_path / "a.csv", f"wavenumber_cm-1,radiance_W_m2_sr_m-1\n{rows}"))
    error = np.abs(np.interp(100 * sigma, spectrum.sigma, spectrum.radiance) - radiance).max()
    assert error < 1.01e-4 * radiance.max()


CSV = "wavelength_nm,radiance_W_m2_sr_nm\n"


@pytest.mark.parametrize(
    ("text", "field", "problem"),
    [
        (CSV + "760,1\n761,nan\n762,1", "radiance", "not finite at data row 2"),
        (CSV + "760,1\n761,-2\n762,1", "radiance", "negative at data row 2"),
        (CSV + "760,1\n762,1\n761,1", "wavelength", "not strictly monotone at data row 3"),
        (CSV + "760,1\n760,1\n761,1", "wavelength", "not strictly monotone at data row 2"),
        (CSV + "-1,1\n2,1", "wavelength", "not positive"),
        (CSV + "760,1", "wavelength", "fewer than two"),
        (CSV + "760,0\n761,0", "radiance", "zero everywhere"),
        (CSV + "760,1\n761,much", "radiance_W_m2_sr_nm", "not a number at data row 2"),
        (CSV + "760,1\n761", "radiance_W_m2_sr_nm", "not a number at data row 2"),
        ("wavelength_ft,radiance_W_m2_sr_nm\n1,1\n2,1", "wavelength_ft", "unknown unit"),
        ("wavelength_nm,radiance_erg\n1,1\n2,1", "radiance_erg", "unknown unit"),
        ("wavelength_nm,light\n1,1\n2,1", "header", "no radiance column"),
        ("radiance_W_m2_sr_nm\n1\n2", "header", "no wavelength"),
        ("wavelength_nm,wavenumber_m-1,radiance_W_m2_sr_nm\n1,1,1", "header", "more than one"),
        ("", "header", "no wavelength"),
    ],
)
def test_broken_csv_is_refused_by_field_and_row(tmp_path, text, field, problem):
    path = write(tmp_path / "broken.csv", text)
    with pytest.raises(InputError, match=problem) as caught:
        load_spectrum(path)
    assert (caught.value.file, caught.value.field) == (str(path), field)


def test_broken_netcdf_is_refused(tmp_path):
    with pytest.raises(InputError, match="not a NetCDF-4 file"):
        load_spectrum(write(tmp_path / "text.nc", "not HDF5"))
    with pytest.raises(InputError, match="cannot be read"):
        load_spectrum(tmp_path / "absent.csv")
    axis = ("x", [1.0, 2.0], {"units": "nm"})
    for name, data, field in (
        ("a.nc", {"wavelength": axis}, "variables"),
        ("b.nc", {"wavelength": axis, "radiance": ("x", [1.0, 1.0])}, "radiance.units"),
        ("c.nc", {"wavelength": ("x", [1.0, 2.0]), "radiance": ("x", [1.0, 1.0])}, "wavelength.units"),
        ("d.nc", {"wavelength": axis, "radiance": (("y", "x"), np.ones((2, 2)))}, "shape"),
    ):
        xarray.Dataset(data).to_netcdf(tmp_path / name, engine="h5netcdf")
        with pytest.raises(InputError) as caught:
            load_spectrum(tmp_path / name)
        assert caught.value.field == field


def test_filter_outside_and_spacing_too_wide_are_refused(tmp_path):
    rows = "\n".join(f"{x},1" for x in np.arange(760.0, 768.1, 0.5))
    path = write(tmp_path / "coarse.csv", CSV + rows)
    with pytest.raises(InputError, match="missing"):
        load_spectrum(path, Filter(450e-9, 5e-9))
    band = Filter(764e-9, 1e-9)
    with pytest.raises(InputError, match="carries OPDs to"):
        load_spectrum(path, band, max_opd_m=1e-3)
    cut = load_spectrum(path, band, max_opd_m=2e-4)
    low, high = band.support()
    assert cut.sigma[0] <= low and cut.sigma[-1] >= high
    assert cut.sigma[0] > 1 / 768e-9
