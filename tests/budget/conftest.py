"""What the tests of this floor share: the reference instrument's bands with their paths, and the small instruments."""

import sys
from pathlib import Path

import pytest

from cgi_wave.budget.setting import band_setting
from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.paths import find_paths

# pytest's importlib mode puts no test folder on the path; small instruments and scenes stand with others.
sys.path[:0] = [str(Path(__file__).parent), *(str(Path(__file__).parents[1] / name) for name in ("rays", "fringes"))]


@pytest.fixture(scope="session")
def instrument():
    """The reference instrument."""
    return load_instrument()


@pytest.fixture(scope="session")
def nir(instrument):
    """Its NIR band."""
    return instrument.band("NIR")


@pytest.fixture(scope="session")
def setting(nir):
    """Spectrum and coherence of the NIR band."""
    return band_setting(nir)


@pytest.fixture(scope="session")
def paths(nir):
    """Nominal paths and the stronger ghosts of both orders of the NIR band."""
    return find_paths(nir, min_power=1e-7, probes=256)
