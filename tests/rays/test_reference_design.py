"""The stored reference instrument: spots, telecentricity, free passage and OPD, by tracing and by closed forms."""

import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from cgi_wave.optics.system import REFERENCE, load_instrument
from cgi_wave.rays.trace import compile_sequence, trace

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
from design import measure
from design.pipeline import full_field, margins, opd_and_fringes, prefixed, rim_rays
from design.report import edges, obstructions
from design.tomlfile import edit

BANDS = ("NIR", "VIS", "SWIR1-CH4", "SWIR1-CO2", "SWIR2")
#: Mirrors of bands of one channel stand this near to each other (m): their foci, within half of it of a middle.
FOCI = {"VISNIR": 0.3e-3, "SWIR": 0.6e-3}
#: What the design was to reach: radial RMS spots (m) and the chief rays' angle at the intermediate image (degrees).
OBJECTIVE, RELAY, CHAIN, TELECENTRIC = 7.5e-6, 7.0e-6, 10.0e-6, 0.2


@pytest.fixture(scope="module", params=BANDS)
def system(request):
    return load_instrument().band(request.param)


def thickness(system, name):
    own = prefixed(system, name)
    return next(s.thickness_mm for f in system.document.frame for s in f.surface if s.name == own) * 1e-3


def plate_index(system, sigma):
    return system.index(sigma)[system.spaces.index(prefixed(system, "arm1_plate"))]


def test_quadrature_of_the_disc():
    points, weight = measure.disc()
    r2 = (points**2).sum(axis=1)
    assert weight.sum() == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(weight @ points, 0.0, atol=1e-15)
    # Mean of r^2k over the unit disc is 1/(k + 1), exact for four rings up to k = 7.
    np.testing.assert_allclose([weight @ r2**k for k in range(8)], 1.0 / np.arange(1, 9), atol=1e-14)


def test_spots_and_telecentricity(system):
    unit, weight = measure.disc(8, 16)
    for path in measure.nominal_paths(system):
        sequence = compile_sequence(system, path, system.sigma0)
        for theta in measure.field_angles(sequence, system.field_points()):
            for nm in system.spec.wavelengths_nm:
                beam = compile_sequence(system, path, 1e9 / nm)
                s = measure.measure_spots(beam, unit * system.pupil_radius, weight, unit * measure.RELAY_SINE, theta)
                assert s.objective < OBJECTIVE and s.relay < RELAY and s.chain < CHAIN
                assert np.degrees(s.telecentric) < TELECENTRIC
                assert s.passing == pytest.approx(1.0)


def test_spots_are_at_the_bands_focus(system):
    """A spot grows when the detector moves by 0.1 mm to either side."""
    unit, weight = measure.disc(8, 16)
    path = measure.nominal_paths(system)[1]
    sequence = compile_sequence(system, path, system.sigma0)
    for theta in measure.field_angles(sequence, system.field_points()):
        t = trace(sequence, unit * system.pupil_radius, theta)
        slope = t.direction / np.sqrt(1 - (t.direction**2).sum(axis=1))[:, None]
        here = measure.spot(t.x, weight)[1]
        assert measure.spot(t.x + 1e-4 * slope, weight)[1] > here
        assert measure.spot(t.x - 1e-4 * slope, weight)[1] > here
        # The cone is F/4: mean square slope of a uniform disc is half of the marginal ray's.
        assert measure.spot(slope, weight)[1] == pytest.approx(0.125 / np.sqrt(2) / np.cos(0.125), rel=0.03)


def test_nothing_cuts_the_full_field(system):
    for surface, margin in margins(system).items():
        # The spots of the outermost pixels' centres may spill over the detector's edge.
        assert margin > (-0.05 if surface.endswith("detector") else 0.3), surface
    for what, margin in obstructions(system).items():
        assert margin > 0.3, what


def test_lenses_have_edges(system):
    assert min(edges(system).values()) > 1.0


def test_an_obstruction_is_found(system):
    shifted = (
        load_instrument().with_values({prefixed(system, "mask_around_M2.shift_mm"): [0.0, 3.5, 0.0]}).band(system.band)
    )
    sequence = compile_sequence(shifted, measure.nominal_paths(system)[0], system.sigma0)
    theta = measure.field_angles(sequence, full_field(shifted)[:1])[0]
    found = measure.obstruction_margins(shifted, sequence, rim_rays(shifted), theta)
    assert min(v for k, v in found.items() if k.startswith(prefixed(system, "relay_mask"))) < 0


def test_magnification_and_focal_length(system):
    x0, x1, y0, y1 = system.zone()
    corners = np.array([(x0, y0), (x1, y1)])
    for path in measure.nominal_paths(system):
        sequence = compile_sequence(system, path, system.sigma0)
        theta = measure.field_angles(sequence, corners)
        step = measure.mirror_step(sequence)
        foot = trace(sequence, np.zeros((2, 2)), theta, footprints=True).foot[step].T
        scale = (foot[1] - foot[0]) / (corners[1] - corners[0])
        np.testing.assert_allclose(np.abs(scale), 1.0, atol=0.01)
        np.testing.assert_allclose(np.abs((foot[1] - foot[0]) / (theta[1] - theta[0])), 0.130, rtol=0.01)


@pytest.mark.parametrize("channel", FOCI)
def test_foci_of_the_bands_are_close(channel):
    instrument = load_instrument()
    gaps = [thickness(instrument.band(band), "plate2_back") for band in instrument.channels[channel]]
    assert max(gaps) - min(gaps) < FOCI[channel]


def test_arms_are_field_widened(system):
    n = plate_index(system, system.sigma0)
    arms = [thickness(system, f"plate{k}_front") / n + thickness(system, f"plate{k}_back") for k in (1, 2)]
    assert arms[0] == pytest.approx(arms[1], abs=1e-8)


def test_group_opd_by_tracing_and_by_closed_form(system):
    opd, fringes = opd_and_fringes(system)
    assert opd == pytest.approx(system.spec.target_opd_mm * 1e-3, abs=1e-7)
    sigma, h = system.sigma0, 1e-4 * system.sigma0
    n_group = (plate_index(system, sigma + h) * (sigma + h) - plate_index(system, sigma - h) * (sigma - h)) / (2 * h)
    # Arm 2's plate is a wedge: at height y it is thicker by y·tan(tilt), its gap the same.
    path = measure.nominal_paths(system)[1]
    sequence = compile_sequence(system, path, sigma)
    _, _, y0, y1 = system.zone()
    ys = np.array([y0, (y0 + y1) / 2, y1])
    theta = measure.field_angles(sequence, np.stack([0 * ys, ys], axis=1))
    step = measure.mirror_step(sequence)
    at = trace(sequence, np.zeros((3, 2)), theta, footprints=True).foot[step][1]
    mirror = prefixed(system, "plate2_back")
    tilt = next(s.tilt_deg[0] for f in system.document.frame for s in f.surface if s.name == mirror)
    wedge = at * np.tan(np.radians(tilt))
    plates = thickness(system, "plate1_front") - thickness(system, "plate2_front") - wedge
    gaps = thickness(system, "plate1_back") - thickness(system, "plate2_back")
    # Along the axis: the chief rays lean by a tenth of a degree, which changes 1.3 mm by 2 nm.
    assert opd == pytest.approx(2 * (n_group * plates[1] + gaps), abs=1e-7)
    n = plate_index(system, sigma)
    assert abs(fringes) == pytest.approx(abs(2 * n * (wedge[2] - wedge[0])) * sigma, rel=2e-3)
    assert abs(fringes) == pytest.approx(10.0, abs=0.01)
    rows = system.spec.zone_rows[1] - system.spec.zone_rows[0]
    assert rows / abs(fringes) > 4


def test_editing_keeps_everything_but_the_values():
    text = REFERENCE.read_text(encoding="utf-8")
    values = {
        "": {"M1.radius_mm": -300.0, "septum.shift_mm": [0.0, -50.0, 1.5], "stop.aperture": {"radius_mm": 9.0}},
        "VIS": {"filter_front.thickness_mm": 1.25, "M2.conic": 0.5},
    }
    new = edit(text, values)
    before, after = text.splitlines(), new.splitlines()
    assert [line for line in before if line.startswith("#")] == [line for line in after if line.startswith("#")]
    assert len(after) == len(before) + 1  # M2.conic is new
    data = tomllib.loads(new)
    named = {item["name"]: item for frame in data["frame"] for item in (frame, *frame["surface"])}
    assert named["M1"]["radius_mm"] == -300.0 and named["M3"]["radius_mm"] != -300.0
    assert named["septum"]["shift_mm"] == [0.0, -50.0, 1.5]
    assert named["stop"]["aperture"] == {"radius_mm": 9.0}
    assert data["band"]["VIS"]["set"]["filter_front.thickness_mm"] == 1.25
    assert data["band"]["VIS"]["set"]["M2.conic"] == 0.5
    assert data["band"]["NIR"]["set"] == tomllib.loads(text)["band"]["NIR"]["set"]
    assert edit(new, values) == new
