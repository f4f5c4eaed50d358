"""The drawing shows where things are: rays end on the detector point they were aimed at, mirrors where they turn."""

import numpy as np
import pytest

from cgi_wave.optics.system import load_instrument
from cgi_wave.report import layout


@pytest.fixture(scope="module")
def system():
    return load_instrument().band("NIR")


@pytest.fixture(scope="module")
def views(system):
    return layout.layout(system)


def test_a_folded_instrument_has_two_views_that_share_their_long_axis(views):
    assert len(views) == 2
    assert views[0]["axes"][0] == views[1]["axes"][0]
    assert {*views[0]["axes"], *views[1]["axes"]} == {"x", "y", "z"}


def test_rays_of_a_group_end_on_one_detector_point(system, views):
    detector = system.surfaces[system.detector]
    for view in views:
        plane = ["xyz".index(axis) for axis in view["axes"]]
        for group, index in enumerate(layout.FIELDS):
            x0 = np.append(system.field_points()[index], 0.0)
            aimed = (x0 @ detector.rotation + detector.origin)[plane]
            ends = np.array([ray["points_m"][-1] for ray in view["rays"] if ray["group"] == group])
            assert len(ends) > layout.FAN  # both arms
            # Aberrations only: an axis mixed up or a mirrored frame would be off by millimetres.
            np.testing.assert_allclose(ends, np.broadcast_to(aimed, ends.shape), atol=1e-4)


def test_profiles_pass_through_their_vertices_and_span_their_apertures(system, views):
    for surface, drawn in zip(system.surfaces, views[0]["surfaces"], strict=True):
        points = layout._profile(surface, "xyz".index({*"xyz"}.difference(views[0]["axes"]).pop()))
        local = (points - surface.origin) @ surface.rotation.T
        np.testing.assert_allclose(local[:, 2], surface.sag(local[:, 0], local[:, 1]), atol=1e-12)
        width = np.ptp(local[:, :2], axis=0).max()
        assert any(width == pytest.approx(2 * half) for half in surface.aperture[1:3])
        assert len(drawn["points_m"]) == len(points)


def test_names_do_not_crowd(views):
    for view in views:
        points = np.concatenate([surface["points_m"] for surface in view["surfaces"]])
        ends = np.array([surface["name_at_m"] for surface in view["surfaces"] if surface["name"]])
        apart = np.hypot(*(ends[:, None] - ends[None]).transpose(2, 0, 1)) + np.eye(len(ends))
        assert len(ends) > 8 and apart.min() > layout.NEAR * np.ptp(points, axis=0).max()


def test_an_element_is_named_once_and_at_an_end_of_it():
    names = ["L1_front", "L1_back", "stop", "relay_septum"]
    assert layout.elements(names) == ["L1", "L1", "stop", "relay_septum"]
    surfaces = [{"name": "", "points_m": np.array([[z, -0.1], [z, 0.1]])} for z in (0.0, 0.01, 0.02, 0.5)]
    layout._put_names(surfaces, layout.elements(names), near=0.05)
    assert [surface["name"] for surface in surfaces] == ["L1", "", "stop", "relay_septum"]
    np.testing.assert_allclose(surfaces[0]["name_at_m"], [0.0, 0.1])
    # The stop stands too near L1 to share its side.
    np.testing.assert_allclose(surfaces[2]["name_at_m"], [0.02, -0.1])
    np.testing.assert_allclose(surfaces[2]["outward"], [0.0, -1.0])
