"""The stored instrument traced a second time, by batoid, from world poses and the list of surfaces alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cgi_wave.optics.system import Instrument, OpticalSystem
from cgi_wave.rays.paths import Path
from cgi_wave.rays.trace import compile_sequence, trace
from design.measure import field_angles, nominal_paths

Array = NDArray[np.float64]


def trace_with_batoid(system: OpticalSystem, path: Path, sigma: float, p: Array, theta: Array) -> tuple[Array, Array]:
    """Detector points (N, 2) m and path lengths (N,) m of rays from pupil points p (N, 2) in direction theta (2,)."""
    import batoid  # dependency group "validation"

    index = system.index(sigma)
    axes, centre = system.pupil_frame()
    back = system.document.entrance.back_off_mm * 1e-3
    direction = np.array([*theta, np.sqrt(1.0 - theta @ theta)])
    start = (np.column_stack([p, np.zeros(len(p))]) - back * direction) @ axes + centre
    velocity = np.tile(direction @ axes, (len(p), 1))
    rays = batoid.RayVector(*start.T.copy(), *velocity.T.copy(), wavelength=1.0 / sigma)
    space = system.spaces.index(system.document.entrance.space)
    for name, act in [*path.steps, (system.document.detector.surface, "absorb")]:
        surface = system.surfaces[system.number[name]]
        if surface.conic != 0.0:
            raise NotImplementedError(f"{name}: only planes and spheres are compared")
        shape = batoid.Sphere(1.0 / surface.curvature) if surface.curvature else batoid.Plane()
        pose = batoid.CoordSys(surface.origin, surface.rotation.T.copy())
        if act == "reflect":
            shape.reflect(rays, coordSys=pose)
        elif act == "transmit":
            other = surface.after if space == surface.before else surface.before
            media = batoid.ConstMedium(index[space]), batoid.ConstMedium(index[other])
            shape.refract(rays, *media, coordSys=pose)
            space = other
        else:
            shape.intersect(rays, coordSys=pose)
    return np.column_stack([rays.x, rays.y]), rays.t - back


def print_comparison(instrument: Instrument, count: int = 200) -> None:
    """Largest differences between the two tracers over bands, arms, field points and wavelengths."""
    radius, angle = np.random.default_rng(0).uniform(size=(2, count))
    unit = np.sqrt(radius)[:, None] * np.stack([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)], axis=1)
    apart = np.zeros(2)
    for band in instrument.bands:
        system = instrument.band(band)
        p = unit * system.pupil_radius
        for path in nominal_paths(system):
            for theta in field_angles(compile_sequence(system, path, system.sigma0), system.field_points()):
                for nm in system.spec.wavelengths_nm:
                    x, opl = trace_with_batoid(system, path, 1e9 / nm, p, theta)
                    own = trace(compile_sequence(system, path, 1e9 / nm), p, theta)
                    apart = np.maximum(apart, [np.abs(x - own.x).max(), np.abs(opl - own.opl).max()])
    print(f"largest difference to batoid: {apart[0]:.1e} m on the detector, {apart[1]:.1e} m in path length")
