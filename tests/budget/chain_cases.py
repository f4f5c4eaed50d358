"""Cases of the whole chain, on traced rays, with the closed form of each; the validation study uses them too.

The closed forms are worked out here from the instrument's numbers and from rays traced once; nothing of the chain's
wave part goes into them.
"""

import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import quad
from scipy.special import j0, j1
from small_instruments import build, detector, frame, surface

from cgi_wave.analysis import Setting, zone_rows
from cgi_wave.budget.fieldpoint import FIT_TARGET, FieldPoint, field_point, pupil_samples
from cgi_wave.budget.setting import MAX_OPD
from cgi_wave.fringes.chebyshev import interpolation_matrix
from cgi_wave.fringes.nma import Retrieval, retrieve
from cgi_wave.fringes.psi import Psi, synthesise
from cgi_wave.optics.system import Instrument, OpticalSystem, from_document
from cgi_wave.rays.beams import nominal_direction, rays_to_point
from cgi_wave.rays.disc import disc
from cgi_wave.rays.paths import Path
from cgi_wave.rays.trace import aim, compile_sequence, jacobian, trace
from cgi_wave.wave.field import PupilField, fit_field
from cgi_wave.wave.overlap import Overlap, overlap

#: A pair of beams may be left out if it adds less than this share of the modulation.
TOLERANCE = 1e-5


# ------------------------------------------------------------------------------------------------ the chain, run


def family(paths, name) -> list[Path]:
    """Both nominal paths and the arm pairs of the single reflection at one surface."""
    return [*paths[:2], *(path for path in paths if path.history == ((name, "reflect"),))]


@dataclass(frozen=True)
class Account:
    """A field point, its interferogram, and what is retrieved from it."""

    point: FieldPoint
    psi: Psi
    retrieval: Retrieval

    @property
    def fringe_period(self) -> float:
        """Λ on the detector, m."""
        return 1.0 / (abs(self.psi.slope) * self.psi.sigma0)

    def gamma(self, first: str, second: str) -> complex:
        """Complex contrast of two beams, named by the ends of their labels, path difference left out, at σ0."""
        labels = self.point.coherency.labels
        m, l = (next(k for k, label in enumerate(labels) if label.endswith(end)) for end in (first, second))  # noqa: E741
        pair = next(pair for pair in self.point.coherency.pairs if {pair.m, pair.l} == {m, l})
        value = complex((interpolation_matrix(pair.sigma, np.array([self.psi.sigma0])) @ pair.gamma)[0])
        return value if pair.m == m else value.conjugate()


def account(system: OpticalSystem, setting: Setting, paths, x0=None, real_light=False) -> Account:
    """Run the chain for some paths; in monochromatic light of σ0 (every closed form's), or the band's own."""
    x0 = system.field_points()[0] if x0 is None else x0
    point = field_point(replace(setting, system=system), paths, x0, TOLERANCE)
    # Retro-ghosts are a metre longer than the nominal beams: the band's own light does not interfere over that, however
    # loose the bound of its coherence there, and light of one wavenumber must not either.
    near = tuple(pair for pair in point.coherency.pairs if np.abs(pair.opd_m).max() < MAX_OPD)
    point = replace(point, coherency=replace(point.coherency, pairs=near))
    light = (setting.spectrum.sigma, setting.weight) if real_light else (np.array([system.sigma0]), np.ones(1))
    psi = synthesise(point.coherency, *light, zone_rows(system, x0), system.pixel)
    return Account(point, psi, retrieve(psi))


def pupil_field(system, path, x0, theta) -> PupilField:
    """G(p, x0) of one path at σ0. Raises EmptyBeamError, MethodLimitError."""
    sigma = np.array([system.sigma0])
    rays = rays_to_point(system, path, x0, sigma, theta)
    return fit_field(pupil_samples(rays, path, "pupil", sigma, x0), target=FIT_TARGET)


def whole(found: Overlap, sigma0: float) -> complex:
    """The complex contrast with its path difference in it."""
    return complex(found.value[0] * np.exp(2j * np.pi * sigma0 * found.opd_m[0]))


def contrast(m: PupilField, l: PupilField, sigma0: float, tol=1e-7) -> tuple[complex, float]:  # noqa: E741
    """Complex contrast of two fields, path difference included, and its bound."""
    found = overlap(m, l, np.array([sigma0]), tol)
    return whole(found, sigma0), float(found.error_bound[0])


# ------------------------------------------------------------------------------------------------ retro-ghosts


def with_splitter_phase(instrument: Instrument, degrees: float, band: str) -> OpticalSystem:
    """The band with both reflections of the splitter taken at this phase (90° conserves energy)."""
    raw = copy.deepcopy(instrument.raw)
    raw["coating"]["splitter"]["reflect_phase_deg"] = degrees
    return from_document(raw).band(band)


def retro_power(instrument: Instrument) -> float:
    """ρτ² of the detector's retro-ghost with every coating met on the way back and forth, the splitter left out.

    Detector once; filter front, filter back and cube exit twice; three AR faces of the arm (cube, plate, plate) twice.
    """
    coating = instrument.raw["coating"]
    ar = coating["ar_high"]["transmittance"]
    return coating["detector"]["reflectance"] * coating["bandpass"]["transmittance"] ** 2 * ar ** (2 + 2 + 6)


def face_power(instrument: Instrument) -> float:
    """R of the filter face's retro-ghost, likewise: cube exit twice, three AR faces of the arm twice."""
    coating = instrument.raw["coating"]
    return coating["bandpass"]["reflectance"] * coating["ar_high"]["transmittance"] ** (2 + 6)


def even_pupil(system: OpticalSystem, count=2000):
    """Points (N, 2), m, spread evenly over the whole entrance pupil."""
    points = disc(count)
    inside = np.hypot(*points.T) < 0.99
    return points[inside] / 0.985 * system.pupil_radius


def displacement(system: OpticalSystem, path: Path, nominal: Path, x0):
    """(N,) m along y: where rays of the source point of ``x0`` land on ``path``, less where they land nominally."""
    theta, p = nominal_direction(system, nominal, x0), even_pupil(system)
    here, there = (trace(compile_sequence(system, which, system.sigma0), p, theta).x for which in (path, nominal))
    return (here - there)[:, 1]


@dataclass(frozen=True)
class FilterFace:
    """Closed form of the filter face's retro-ghost: O/B = κ(R/2)(1 − J/2), M*/M = −κ(R/2)(1 − J).

    distance: air-equivalent, m; z: 2π(d/F#)/Λ; kappa: the beam's gain of solid angle, as its pupil is not at infinity.
    """

    distance: float
    f_number: float
    z: float
    j: float
    kappa: float
    offset: float
    parasitic: float


def own(system: OpticalSystem, name: str) -> str:
    """A surface or frame of the band's channel: the parts of the reference's SWIR channel have the same names, after
    ``swir_``."""
    return system.document.detector.surface.removesuffix("detector") + name


def filter_at(instrument: Instrument, band: str, gap_mm: float) -> OpticalSystem:
    """The band with the filter moved to ``gap_mm`` before the detector; its glass, and so the focus, stay."""
    system = instrument.band(band)
    thickness = system.document.band[band].set[own(system, "filter_front.thickness_mm")]
    moved = {
        own(system, "filter_back.thickness_mm"): gap_mm,
        own(system, "focal.start_mm"): -(thickness + gap_mm),
    }
    return instrument.with_values(moved, band).band(band)


def filter_face(instrument: Instrument, system: OpticalSystem, nominal: Path, period: float) -> FilterFace:
    """What the closed form gives at the zone's centre, for the fringe period Λ (m) there.

    The ghost's image lies 2d before the detector, so that its blur has the radius d/F#; the fringes of its first pass
    are averaged over that disc. Seen from there, an exit pupil at the distance 1/K fills (1 + 2dK) times the angle.
    """
    surfaces = {s.name: s for s in system.surfaces}
    front, back, detector = (own(system, name) for name in ("filter_front", "filter_back", "detector"))
    x0 = system.field_points()[0]

    def apart(a, b):
        return float(np.linalg.norm(surfaces[a].origin - surfaces[b].origin))

    index = system.index(system.sigma0)[surfaces[front].after]
    distance = apart(front, back) / index + apart(back, detector)
    theta, sequence = nominal_direction(system, nominal, x0), compile_sequence(system, nominal, system.sigma0)
    rim = system.pupil_radius * (1 - 1e-9) * np.array([[0.0, 1.0], [0.0, -1.0]])
    sine = np.ptp(trace(sequence, rim, theta).direction[:, 1]) / 2
    f_number = 1.0 / (2.0 * np.tan(np.arcsin(sine)))
    by_theta = jacobian(sequence, np.zeros((1, 2)), theta)
    bend = by_theta[1][0] @ np.linalg.inv(by_theta[0][0])  # how the chief ray's direction turns along the detector
    kappa = float(np.linalg.det(np.eye(2) + 2.0 * distance * bend))
    z = 2.0 * np.pi * distance / f_number / period
    j = 2.0 * j1(z) / z
    half = kappa * face_power(instrument) / 2
    return FilterFace(distance, f_number, z, j, kappa, half * (1 - j / 2), -half * (1 - j))


# ------------------------------------------------------------------------------------------------ a parabola's focus

FOCAL, RADIUS, INDEX = 40e-3, 5e-3, 1.5
NOMINAL = "mirror:r front_face back_face"
PLATE_GHOST = "mirror:r front_face back_face:r front_face:r back_face"


def parabola(plate_mm: float, defocus_mm=0.0, behind_mm=0.2, coating="coated", edge_mm=None) -> OpticalSystem:
    """An F/4 parabola on its axis (f = 40 mm) and a plane plate ``behind_mm`` before the detector.

    defocus_mm: of the detector from the paraxial focus, away from the mirror. The mirror has no spherical aberration:
    a source on the axis makes a spherical wave. edge_mm: radius of the detector, else wide.
    """
    focal = FOCAL * 1e3
    start = focal + plate_mm * (1 - 1 / INDEX) + defocus_mm - plate_mm - behind_mm
    shape = {"radius": -2 * focal, "conic": -1.0, "aperture": 20.0}
    mirror = frame("turn", "room", surface("mirror", "", coating="mirror", nominal="reflect", **shape), start_mm=10.0)
    faces = (
        surface("front_face", "glass", plate_mm, coating=coating, aperture=20.0),
        surface("back_face", "behind", behind_mm, coating=coating, aperture=20.0),
    )
    last = detector() if edge_mm is None else surface("detector", "", aperture=edge_mm, nominal="absorb")
    end = frame("end", "room", *faces, last, shift_mm=[0.0, 0.0, 10.0 - start], rotate_deg=[180.0, 0.0, 0.0])
    coatings = {"coated": {"reflectance": 0.04, "transmittance": 0.96}}
    return build([mirror, end], {"room": 1.0, "glass": INDEX, "behind": 1.0}, radius=RADIUS * 1e3, coating=coatings)


def radial(system: OpticalSystem, path_difference, m=None, l=None) -> complex:  # noqa: E741
    """∫ √(m l) exp(i 2πσ·difference(θ)) dA / √(∫m dA ∫l dA) over the pupil: r = 2f tan(θ/2) on a parabola.

    m, l: power along each ray as a function of θ (1 if None).
    """
    m, l = (function or (lambda angle: 1.0) for function in (m, l))  # noqa: E741

    def mean(function):
        return quad(lambda r: 2 * r / RADIUS**2 * function(2 * np.arctan(r / (2 * FOCAL))), 0, RADIUS, limit=1000)[0]

    def at(angle):
        return np.sqrt(m(angle) * l(angle)) * np.exp(2j * np.pi * system.sigma0 * path_difference(angle))

    cross = mean(lambda angle: at(angle).real) + 1j * mean(lambda angle: at(angle).imag)
    return cross / np.sqrt(mean(m) * mean(l))


def plate_path(plate_mm: float):
    """Extra path (m) of a ray at angle θ that crosses a plate twice more: 2 n t cos θ′, the exact eikonal."""
    return lambda angle: 2 * INDEX * plate_mm * 1e-3 * np.sqrt(1 - (np.sin(angle) / INDEX) ** 2)


def landing(plate_mm: float, angle: float) -> float:
    """Distance (m) from the axis at which a ray at an angle θ lands that crosses the plate three times.

    Exact, on a detector in the paraxial focus behind the plate.
    """
    within = np.tan(np.arcsin(np.sin(angle) / INDEX))
    return plate_mm * 1e-3 * (3 * within - np.tan(angle) / INDEX)


def on_a_detector(system: OpticalSystem, path_difference, edge: float) -> tuple[complex, float]:
    """∫ h_m h_l* d²x over a detector of radius ``edge``, m, over √(P_m P_l) of both whole beams; P_m on it over P_m.

    For beams of the parabola that differ by a path; h by Hankel transforms of √|∂p/∂q|, with nothing stationary. Good
    for edges up to 0.4 mm.
    """
    t, weight = np.polynomial.legendre.leggauss(700)
    sine = np.sin(2 * np.arctan(RADIUS / (2 * FOCAL)))
    q, dq = 0.5 * sine * (t + 1), 0.5 * sine * weight
    angle = np.arcsin(q)
    # r dr = (r dr/dq) dq with r = 2f tan(θ/2), q = sin θ.
    r, by_q = 2 * FOCAL * np.tan(angle / 2), FOCAL / np.cos(angle / 2) ** 2 / np.cos(angle)
    element = np.sqrt(r * by_q * q) * dq
    rho, drho = 0.5 * edge * (t + 1), 0.5 * edge * weight
    wave = 2 * np.pi * system.sigma0 * j0(2 * np.pi * system.sigma0 * np.outer(rho, q))
    nominal, ghost = wave @ element, wave @ (element * np.exp(2j * np.pi * system.sigma0 * path_difference(angle)))
    whole = RADIUS**2 / 2
    return complex(ghost @ (nominal * rho * drho)) / whole, float(np.abs(ghost) ** 2 @ (rho * drho)) / whole


def fresnel(angle):
    """Power reflectance of a bare face for unpolarised light, from the angle in air."""
    c, c2 = np.cos(angle), np.sqrt(1 - (np.sin(angle) / INDEX) ** 2)
    return 0.5 * (((c - INDEX * c2) / (c + INDEX * c2)) ** 2 + ((INDEX * c - c2) / (INDEX * c + c2)) ** 2)


# ------------------------------------------------------------------------------------------------ brute force


def landing_power(system: OpticalSystem, path: Path, x0, half: float, count: int) -> tuple[float, float]:
    """Light of a uniform scene (radiance 1) per area of a square ±half (m) about x0, by random rays; relative error.

    Random pupil points and directions, counted where they land: no aiming, no Jacobian, no fit. Unit as ∫A² d²p.
    """
    sequence = compile_sequence(system, path, system.sigma0)
    theta, ok = aim(sequence, even_pupil(system, 300), x0, np.zeros(2))
    # A virtual ray brings no light: where it would have to start need not be covered.
    ok[ok] = trace(sequence, even_pupil(system, 300)[ok], theta[ok]).status == 0
    some = even_pupil(system, 300)[ok]
    move = np.abs(np.linalg.inv(jacobian(sequence, some, theta[ok])[0])).sum(axis=2).max(axis=0) * half
    return landed_from(
        system, path, x0, half, count, (theta[ok].min(axis=0) - 1.5 * move, theta[ok].max(axis=0) + 1.5 * move)
    )


def landed_from(system: OpticalSystem, path: Path, x0, half: float, count: int, box, seed=1) -> tuple[float, float]:
    """``landing_power`` from directions between the two corners of ``box``."""
    rng, (low, high) = np.random.default_rng(seed), box
    sequence = compile_sequence(system, path, system.sigma0)
    radius, angle = system.pupil_radius * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    p = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    ray = trace(sequence, p, low + (high - low) * rng.random((count, 2)))
    hit = np.where(ray.passes & (np.abs(ray.x - x0) < half).all(axis=1), ray.power, 0.0)
    measure = float(np.prod(high - low)) * np.pi * system.pupil_radius**2 / count / (4 * half**2)
    return float(hit.sum()) * measure, float(np.sqrt((hit**2).sum()) / hit.sum())
