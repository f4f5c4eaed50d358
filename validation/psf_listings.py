"""Zemax's Huygens PSFs of two telescopes, as listed in batoid's tests, against ours on batoid's rays.

The listings are not part of this package: give the folder that holds them (tests/testdata of a checkout of batoid).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cgi_wave.wave.field import PupilField, fit_field
from cgi_wave.wave.methods import nufft
from cgi_wave.wave.methods.nodes import Nodes
from cgi_wave.wave.methods.patch import Patch
from cgi_wave.wave.methods.shape import beam_at
from cgi_wave.wave.samples import PupilSamples

Array = NDArray[np.float64]
COLUMNS = ("listing", "largest difference", "rms", "ours − batoid", "batoid − listing", "misfit / waves", "note")
_BEYOND = 0.12  # clearance down to which rays outside an aperture are kept
#: file, batoid's telescope, wavelength (m), field (deg), pitch (m)
LISTINGS = (
    ("HSC_huygensPSF.txt", "HSC_no_obsc.yaml", 750e-9, (0.0, 0.75), 0.25e-6),
    ("LSST_hpsf_0.0_0.0.txt", "LSST_g_500.yaml", 500e-9, (0.0, 0.0), 0.289e-6),
    ("LSST_hpsf_0.0_1.225.txt", "LSST_g_500.yaml", 500e-9, (0.0, 1.225), 0.289e-6),
    ("LSST_hpsf_0.0_1.75.txt", "LSST_g_500.yaml", 500e-9, (0.0, 1.75), 0.289e-6),
    ("LSST_hpsf_1.176_1.176.txt", "LSST_g_500.yaml", 500e-9, (1.176, 1.176), 0.289e-6),
)


def read_listing(file: Path) -> Array:
    """Relative intensity [y, x], y upwards, of a Zemax listing in UTF-8 or UTF-16."""
    raw = file.read_bytes()
    text = raw.decode("utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8")
    rows = [line.split() for line in text.splitlines()]
    start = next(i for i, row in enumerate(rows) if row[:3] == ["Values", "are", "relative"])
    values = np.array([[float(v) for v in row] for row in rows[start + 1 :] if row])
    return values[::-1]


def pupil_field(
    telescope: Any, wavelength: float, angle: tuple[float, float], rays: int = 3000, reach: float = 1.1
) -> PupilField:
    """The field of batoid's rays over direction cosines at the focal plane, about the chief ray.

    Uniform in the entrance pupil, so that the amplitude over q is the root of |∂p/∂q|.
    """
    import batoid

    k = np.arange(rays) + 0.5
    edge = 0.5 * telescope.pupilSize
    radius, turn = reach * edge * np.sqrt(k / rays), k * np.pi * (3.0 - np.sqrt(5.0))
    px, py = radius * np.cos(turn), radius * np.sin(turn)
    theta = np.deg2rad(angle)
    start = batoid.RayVector.fromStop(
        np.append(px, 0.0), np.append(py, 0.0), optic=telescope, wavelength=wavelength, theta_x=theta[0],
        theta_y=theta[1], projection="zemax",
    )  # fmt: skip
    clearance = _clearances(telescope, start.copy())
    ends = telescope.trace(start.copy())
    v = ends.v / np.linalg.norm(ends.v, axis=1)[:, None]
    # Rays that miss a lens by far leave it anywhere; the boundary needs those just beyond an aperture.
    good = ~ends.failed & (clearance.min(axis=0) > -_BEYOND)
    x0 = ends.r[-1]
    opl = ends.t - np.einsum("ij,ij->i", v, ends.r - x0)
    opl -= opl[-1]
    good[-1] = False
    p = np.column_stack([np.append(px, 0.0), np.append(py, 0.0)])[good] / edge
    q = v[good, :2]
    return fit_field(
        PupilSamples(
            "listing",
            "direction",
            q[None],
            np.array([1.0 / wavelength]),
            opl[good][None],
            np.sqrt(np.abs(1.0 / _jacobian(p, q)))[None],
            clearance[:, None, good],
            q[None],
            0.0,
            (0.0, 0.0),
        )
    )


def _jacobian(p: Array, q: Array) -> Array:
    """det ∂q/∂p at the samples, from polynomials of degree 8 in p through the directions."""
    scale = np.abs(p).max()
    i, j = np.array([(i, d - i) for d in range(9) for i in range(d + 1)]).T
    cheb = np.polynomial.chebyshev
    x, y = (cheb.chebvander(p[:, a] / scale, 8) for a in (0, 1))
    coef, *_ = np.linalg.lstsq(x[:, i] * y[:, j], q, rcond=None)
    slope = [np.zeros_like(x), np.zeros_like(y)]
    for n in range(1, 9):
        unit = np.zeros(9)
        unit[n] = 1.0
        for a in (0, 1):
            slope[a][:, n] = cheb.chebval(p[:, a] / scale, cheb.chebder(unit)) / scale
    dx, dy = (slope[0][:, i] * y[:, j]) @ coef, (x[:, i] * slope[1][:, j]) @ coef
    return np.asarray(dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0])


def _clearances(telescope: Any, rays: Any) -> Array:
    """(K, N) signed clearance of every circular or annular aperture on the way, and of the entrance pupil."""
    import batoid

    found = []
    for step in telescope.traceFull(rays).values():
        item, out = telescope[step["name"]], step["out"]
        mask = item.obscuration
        if mask is None:
            continue
        turned = isinstance(mask, batoid.ObscNegation)
        shape = mask.original if turned else mask
        r2 = (out.x - shape.x) ** 2 + (out.y - shape.y) ** 2
        # An obscuration blocks what it contains; its negation is the clear aperture.
        if isinstance(shape, batoid.ObscCircle):
            clear = [(1.0 - r2 / shape.radius**2) * (1.0 if turned else -1.0)]
        elif isinstance(shape, batoid.ObscAnnulus) and turned:
            clear = [1.0 - r2 / shape.outer**2, r2 / shape.outer**2 - (shape.inner / shape.outer) ** 2]
        else:
            raise ValueError(f"{step['name']}: {shape} is neither a circle nor an annulus")
        found += [np.where(np.isfinite(c), c, -1.0) for c in clear]
    return np.array(found)


def _offset(image: Callable[[Array], Array], want: Array) -> Array:
    """Shift (2,), in pixels, that brings our image nearest to the listing: the peak of their correlation."""
    ours = image(np.zeros(2))
    correlation = np.fft.ifft2(np.fft.fft2(ours) * np.conj(np.fft.fft2(want))).real
    at = np.array(np.unravel_index(np.argmax(correlation), want.shape))
    at = np.where(at > np.array(want.shape) // 2, at - np.array(want.shape), at)
    return np.asarray(at[::-1], float)


def compare(folder: Path) -> list[dict[str, Any]]:
    """One row for each listing: largest and rms difference of intensity over the peak, after shift and scale.

    Beside it batoid's own sum over a grid of 128² rays, in place: against ours (which weighs rays by the root of the
    Jacobian, as power asks, where it weighs them alike) and against the listing.
    """
    import batoid

    rows = []
    for name, telescope, wavelength, angle, pitch in LISTINGS:
        file = folder / name
        if not file.is_file():
            rows.append(dict.fromkeys(COLUMNS, None) | {"listing": name, "note": "absent"})
            continue
        want = read_listing(file)
        want = want / want.max()
        field = pupil_field(batoid.Optic.fromYaml(telescope), wavelength, angle)
        beam = beam_at(field, 1.0 / wavelength)
        n = want.shape[0]
        patch = Patch((-(n // 2), -(n // 2)), (n, n), (pitch, pitch))
        nodes, _ = nufft.nodes_for(beam, patch, 1e-7)

        def image(shift: Array, nodes: Nodes = nodes, patch: Patch = patch, sigma: float = beam.sigma) -> Array:
            moved = Nodes(nodes.u, nodes.strength * np.exp(2j * np.pi * sigma * (nodes.u @ shift)))
            h, _ = nufft.transform(moved, sigma, patch, 1e-9)
            return np.asarray(np.abs(h.T) ** 2)

        offset = _offset(image, want)

        def residual(x: Array, want: Array = want, pitch: float = pitch, start: Array = offset) -> Array:
            ours = image((start + x[:2] - 1.0) * pitch)
            return np.asarray((ours / np.sqrt(np.vdot(ours, ours) / np.vdot(want, want)) * x[2] - want).ravel())

        best = least_squares(residual, np.ones(3), diff_step=1e-4)  # about 1, since steps are relative
        theirs = batoid.huygensPSF(
            batoid.Optic.fromYaml(telescope), *np.deg2rad(angle), wavelength, projection="zemax", nx=128, dx=pitch,
            nxOut=n, reference="chief",
        ).array  # fmt: skip
        ours = image(np.zeros(2))
        row = (
            name,
            float(np.abs(best.fun).max()),
            float(np.sqrt(np.mean(best.fun**2))),
            float(np.abs(ours / ours.max() - theirs / theirs.max()).max()),
            float(np.abs(theirs / theirs.max() - want).max()),
            field.opl_residual / wavelength,
            f"{n}² points of {pitch * 1e6:g} µm",
        )
        rows.append(dict(zip(COLUMNS, row, strict=True)))
    return rows
