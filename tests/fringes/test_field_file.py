"""Fringe fields in files: the round trip, what a file is refused for, and parts of a field."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from synthetic_fields import dark_row, michelson, spectrum

from cgi_wave.errors import InputError
from cgi_wave.fringes.field import MutualKernel, NominalPsf, SceneView
from cgi_wave.fringes.field_file import load_field, save_field
from cgi_wave.fringes.pattern import fringe_patterns
from cgi_wave.fringes.subfield import with_families


def same(one, other):
    if is_dataclass(one):
        if isinstance(one, SceneView):  # single numbers may come back for double ones, where nothing is lost
            one, other = (replace(view, stored=view.kernel.astype(np.float64)) for view in (one, other))
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    return type(one) is type(other) and one == other


@pytest.mark.parametrize("shadows", [(), (dark_row(110), dark_row(118, arm=2))], ids=["lit", "shaded"])
def test_a_field_comes_back_to_the_bit(tmp_path, shadows):
    """Also with pairs of another number of wavenumbers."""
    field = michelson(shadows=shadows)
    short = field.pairs[2]
    short = replace(short, sigma=short.sigma[:1], gamma=short.gamma[:1], opd_m=short.opd_m[:1], error=1e-7)
    kernels = np.random.default_rng(0).random((3, 2, 5, 5))
    psf = NominalPsf(np.arange(2.0), np.arange(3.0), kernels, np.ones((1, 2)), kernels[:1, 0], 0.01, 0.02)
    rng = np.random.default_rng(1)
    pairs = tuple(
        replace(pair, mutual=MutualKernel(rng.random((3 + 2 * k, 5)) + 1j * rng.random((3 + 2 * k, 5)), k + 1, 0.5))
        for k, pair in enumerate((*field.pairs[:2], short, *field.pairs[3:]))
    )
    field = replace(field, pairs=pairs, left_out=0.1, psf=psf)
    save_field(field, tmp_path / "field.nc", {"instrument_hash": "abc"})
    read = load_field(tmp_path / "field.nc", {"instrument_hash": "abc"})
    assert same(read, field)
    assert not same(read, replace(field, left_out=0.2))
    assert [file.name for file in tmp_path.iterdir()] == ["field.nc"]


def test_a_field_without_ghosts_comes_back(tmp_path):
    field = with_families(michelson(), ())
    save_field(field, tmp_path / "field.nc")
    assert same(load_field(tmp_path / "field.nc"), field)


def test_kernels_that_are_single_numbers_stay_so(tmp_path):
    """They are most of a field in memory; others lose nothing either."""
    field = michelson()
    exact = tuple(replace(view, stored=np.array([[0.1, 0.2], [0.3, 0.4]])) for view in field.views)
    single = tuple(replace(view, stored=view.kernel.astype(np.float32).astype(np.float64)) for view in exact)
    assert exact
    for views, dtype in ((exact, np.float64), (single, np.float32)):
        save_field(replace(field, views=views), tmp_path / "field.nc")
        for view, read in zip(views, load_field(tmp_path / "field.nc").views, strict=True):
            assert read.kernel.dtype == dtype
            np.testing.assert_array_equal(read.kernel, view.kernel)


def test_kernels_stay_in_the_file_and_miss_it(tmp_path):
    """What is read later is what was written; a file that is gone or another one is not taken for it."""
    field, file = michelson(), tmp_path / "field.nc"
    save_field(field, file)
    read = load_field(file)
    assert not any(isinstance(view.stored, np.ndarray) for view in read.views)
    save_field(with_families(field, ()), file)
    with pytest.raises(InputError, match=r"field\.nc.*has changed"):
        _ = read.views[0].kernel
    file.unlink()
    with pytest.raises(InputError, match=r"field\.nc.*cannot be read any more"):
        _ = read.views[0].kernel


def test_a_field_of_something_else_is_refused(tmp_path):
    save_field(michelson(), tmp_path / "field.nc", {"instrument_hash": "abc"})
    with pytest.raises(InputError, match=r"instrument_hash = 'abc'.*'def'"):
        load_field(tmp_path / "field.nc", {"instrument_hash": "def"})
    with pytest.raises(InputError, match="cannot be written"):
        save_field(michelson(), tmp_path / "nowhere" / "field.nc")
    (tmp_path / "text.nc").write_text("no field")
    with pytest.raises(InputError, match="cannot be read"):
        load_field(tmp_path / "text.nc")


def test_parts_of_a_field_add_up_where_families_do_not_interfere():
    """Baselines and pairs are linear in the light: nominal plus what each family adds is the whole."""
    field = michelson()
    sigma, weights = spectrum()
    whole = sum(layer.pattern for layer in fringe_patterns(field, sigma, weights))
    (bare,) = fringe_patterns(with_families(field, ()), sigma, weights)
    total = bare.pattern.copy()
    for family in (1, 2):
        part = with_families(field, (family,))
        assert set(part.family) == {0, family}
        total += sum(layer.pattern for layer in fringe_patterns(part, sigma, weights)) - bare.pattern
    np.testing.assert_allclose(total, whole, atol=2e-7)
    assert np.abs(whole - bare.pattern).max() > 1e-3
