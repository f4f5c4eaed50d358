"""Polarisation at the splitter: s and p computed apart and added as powers must give what the bound is made of."""

from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from fringe_scenes import ROWS, SIGMA0, retro_family

from cgi_wave.budget.polarisation import SplitterPowers, polarisation_bound, polarised, splitter_powers
from cgi_wave.errors import InputError
from cgi_wave.fringes.nma import retrieve
from cgi_wave.fringes.psi import synthesise
from cgi_wave.optics.system import from_document, load_instrument
from cgi_wave.rays.paths import find_paths

SIGMA, ONE = np.array([SIGMA0]), np.ones(1)
OPD = 1.33e-3


def paths_of_retro():
    """Splitter passes of two nominal beams, and of the arm pairs of a reflector behind the interferometer."""
    once = [("splitter", "reflect"), ("splitter", "transmit")]
    back = ([("splitter", "reflect")] * 2, [("splitter", "transmit")] * 2)
    return [SimpleNamespace(steps=once)] * 2 + [SimpleNamespace(steps=once + back[b]) for _ in (0, 1) for b in (0, 1)]


def irradiance(coherency):
    return synthesise(coherency, SIGMA, ONE, ROWS).coherent.irradiance


@pytest.mark.parametrize("s", [0.0, 0.3, 1.0])
def test_s_and_p_add_as_powers(s):
    """The interferogram of a mixture is that of a splitter with R_s and that of one with R_p, weighted."""
    r_s, r_p = 0.6, 0.37
    powers = SplitterPowers((0.5, 0.5), (r_s, 1 - r_s), (r_p, 1 - r_p), True)
    mixed = polarised(retro_family(OPD, 0.05), paths_of_retro(), "splitter", powers, s)
    apart = [irradiance(retro_family(OPD, 0.05, reflectance=r)) for r in (r_s, r_p)]
    assert irradiance(mixed) == pytest.approx(s * apart[0] + (1 - s) * apart[1], rel=1e-12)
    assert all(abs(pair.gamma) <= 1 + 1e-12 for pair in mixed.pairs)


def test_a_splitter_that_treats_both_alike_changes_nothing():
    plain = retro_family(OPD, 0.05, shear=0.4)
    powers = SplitterPowers((0.5, 0.5), (0.5, 0.5), (0.5, 0.5), False)
    same = polarised(plain, paths_of_retro(), "splitter", powers, 0.8)
    assert irradiance(same) == pytest.approx(irradiance(plain), rel=1e-14)


def test_retro_ghost_by_closed_form():
    """Behind a splitter with R = 1/2 ± d: nominal 1 − 4d², and a lossless interferometer returns ρτ²·N(1 − N)."""
    d, power = 0.05, 0.04
    powers = SplitterPowers((0.5, 0.5), (0.5 + d, 0.5 - d), (0.5 - d, 0.5 + d), False)
    found = retrieve(synthesise(polarised(retro_family(OPD, power), paths_of_retro(), "splitter", powers, 0.9),
                                SIGMA, ONE, ROWS))  # fmt: skip
    v = 1 - 4 * d * d
    assert found.nominal.baseline.value == pytest.approx(0.5 * v, rel=1e-9)
    # N = v(1 + cos φ)/2: mean of N(1 − N) is v/2 − 3v²/8, its part at the fringe frequency v/2 − v²/2.
    assert found.coherent.offset_over_baseline.value == pytest.approx(power * (1 - 0.75 * v), rel=1e-6)
    assert found.coherent.parasitic_over_modulation.value == pytest.approx(power * (1 - v), abs=1e-6 * power)


def bound(system, **options):
    nominal = find_paths(system, max_order=0, max_splits=0)
    paths = [*nominal, *paths_of_retro()[2:]]
    name = system.document.interferometer.splitter
    paths[2:] = [SimpleNamespace(steps=[(name, act) for _, act in path.steps]) for path in paths[2:]]
    return polarisation_bound(system, retro_family(OPD, 0.05), paths, SIGMA, ONE, ROWS, np.zeros(2), **options)


def test_the_bound_holds_over_all_states_and_says_what_it_assumed():
    system = load_instrument().band("NIR")
    whole = bound(system)
    assert not whole.declared and (whole.r_s, whole.r_p) == pytest.approx((0.55, 0.45))
    assert whole.nominal_modulation == pytest.approx(0.01, rel=1e-6) == whole.nominal_power
    inter = system.document.interferometer
    plain = retrieve(synthesise(retro_family(OPD, 0.05), SIGMA, ONE, ROWS)).coherent
    paths = [SimpleNamespace(steps=[(inter.splitter, act) for _, act in p.steps]) for p in paths_of_retro()]
    powers = splitter_powers(system, np.sqrt(0.5))
    for s in np.linspace(0.0, 1.0, 9):
        here = retrieve(synthesise(polarised(retro_family(OPD, 0.05), paths, inter.splitter, powers, s), SIGMA, ONE,
                                   ROWS)).coherent  # fmt: skip
        change = here.nma_error.value - plain.nma_error.value
        assert abs(change) <= whole.nma_error * (1 + 1e-9)
    assert bound(system, spread=0.02).nma_error < 0.1 * whole.nma_error
    assert bound(system, spread=0.0).nma_error == pytest.approx(0.0, abs=1e-14)


def test_a_declared_table_is_taken_at_the_splitters_incidence():
    instrument = load_instrument()
    raw = msgspec.json.decode(msgspec.json.encode(instrument.raw))
    raw["coating"]["splitter"] = {"reflect_phase_deg": 90.0, "table": {
        "wavelengths_nm": [400.0, 2200.0], "angles_deg": [30.0, 45.0, 60.0],
        "reflectance_s": [[0.5, 0.58, 0.7]] * 2, "reflectance_p": [[0.5, 0.44, 0.3]] * 2}}  # fmt: skip
    found = bound(from_document(raw, instrument.file).band("NIR"))
    assert found.declared
    assert (found.r_s, found.r_p) == pytest.approx((0.58, 0.44), abs=0.02)
    assert found.t_s == pytest.approx(1 - found.r_s)


@pytest.mark.parametrize("options, field", [({"degree": 1.5}, "degree"), ({"spread": 1.2}, "spread")])
def test_what_is_no_state_is_refused(options, field):
    with pytest.raises(InputError, match=field):
        bound(load_instrument().band("NIR"), **options)
