"""The fringe field: powers, contrasts and path differences of all beams, known over a zone of the detector.

Every quantity of Eq. 2 is given on a grid of Chebyshev nodes over the zone, where field points were traced, and is a
polynomial in between. What that leaves over is measured at further traced points.

Coordinates: x across track, y along track (the OPD axis), m, on the detector, from its centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes import chebyshev
from cgi_wave.fringes.coherency import Coherency

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class MutualKernel:
    """What the mutual kernel of a pair has beyond gamma times the kernel of the image that frames give its light.

    apart (h, w) complex : [Y, X], of sum 0, in units of √(t_m t_l), for cells of step × step pixels; at the zone's
    centre, times the coherence of the light at the pair's path differences
    most : Σ|apart|, and what could not be computed
    """

    apart: Complex
    step: int
    most: float


@dataclass(frozen=True)
class FieldPair:
    """Mutual coherence of beams m and l at S wavenumbers over the zone's nodes.

    The pair's part of the irradiance is 2√(t_m t_l) Re[gamma exp(i 2πσ opd_m)]; both are given for one pupil point, the
    same at all nodes, so that they vary smoothly.

    sigma (S,) 1/m; gamma (S, Y, X) complex, |gamma| ≤ 1; opd_m (S, Y, X) m
    error : largest bound on the error of gamma at the nodes
    interpolation : largest |difference| of √(t_m t_l) gamma, phase included, at the traced points between the nodes
    mutual : how the pair's light is spread over the ground; None: not known
    """

    m: int
    l: int  # noqa: E741  (the paper's symbol)
    sigma: Array
    gamma: Complex
    opd_m: Array
    error: float
    interpolation: float
    mutual: MutualKernel | None = None


@dataclass(frozen=True)
class Shadow:
    """A dead zone: at y_m the thickness of an arm's plate steps, and cuts the converging beam of that arm.

    Light that comes to a focus at a distance d from the step crosses it within a disc of radius half_width_m: the part
    of the disc beyond d is lost, on the way in and, mirrored, on the way out.
    """

    arm: int
    y_m: float
    half_width_m: float

    def passed(self, y: Array) -> Array:
        """Share of the arm's light that passes the step, at rows y (R,)."""
        d = np.clip(np.abs(y - self.y_m) / self.half_width_m, 0.0, 1.0)
        return np.asarray(1.0 - 2.0 * (np.arccos(d) - d * np.sqrt(1.0 - d * d)) / np.pi)


class StoredKernel(Protocol):
    """A kernel that stays in a file until it is wanted: families by the hundred hold more than all the rest."""

    @property
    def shape(self) -> tuple[int, int]: ...
    def read(self) -> NDArray[np.floating]:
        """Its values."""
        ...


@dataclass(frozen=True)
class SceneView:
    """How one family of ghosts sees the scene: source directions as the places where the nominal beam images them.

    family : number of the family; affine (2, 3): mean place (X, Y) = affine @ (x, y, 1) of the light on detector point
    (x, y), m; kernel (H, W): how that light is spread about its mean, at the detector's pixel pitch, [Y, X], both sizes
    odd, sum 1 (1 × 1: within a pixel), ``stored`` as an array or in a file, from where it is read each time; misfit_m :
    largest distance of a node's mean place from the affine map
    """

    family: int
    name: str
    affine: Array
    stored: NDArray[np.floating] | StoredKernel
    misfit_m: float

    @property
    def kernel(self) -> NDArray[np.floating]:
        """(H, W)."""
        return self.stored if isinstance(self.stored, np.ndarray) else self.stored.read()

    @property
    def shape(self) -> tuple[int, int]:
        """H and W."""
        height, width = self.stored.shape
        return height, width

    @property
    def blurs(self) -> bool:
        """Whether light is spread beyond a pixel."""
        return self.shape != (1, 1)


@dataclass(frozen=True)
class NominalPsf:
    """The nominal point-spread function over a zone: weights of ground cells for a pixel, at the detector's pitch.

    x_m (X,), y_m (Y,) : Chebyshev nodes over the zone, m; kernel (Y, X, h, w) : [Y, X] about the ray through the
    pupil's centre, sizes odd, sum 1; cells and pixels are both averaged over
    check_m (N, 2) : traced points (x, y) between the nodes, m; check (N, h, w) : the kernels there
    outside : largest share of the light beyond the kernel's window, which the kernel spreads within it
    arms : largest Σ|difference| between the nominal beams' kernels, fringes included, and this one
    """

    x_m: Array
    y_m: Array
    kernel: Array
    check_m: Array
    check: Array
    outside: float
    arms: float


@dataclass(frozen=True)
class FringeField:
    """All beams of one band over one zone of the detector. labels[0] and labels[1] are the nominal beams.

    x_m (X,), y_m (Y,) : Chebyshev nodes over the zone, m; zone : x0, x1, y0, y1, m (pixel edges)
    rows, columns : first and last + 1 pixel of the zone; pixel_m : pitch
    family (B,), order (B,) ; arms (B, 2) : how often each beam passes arm 1 and arm 2
    transmission (B, Y, X) : powers relative to the input; transmission_error (B,) : absolute, at the nodes
    transmission_interpolation : largest misfit of the sum of ghost powers at the traced points between the nodes
    sigma0 : 1/m, wavenumber of the carrier; views : one per family of ghosts
    left_out, left_out_baseline : largest over the nodes of what was not computed, relative to M (see ``psi``)
    psf : of the nominal beams; None: they image the scene sharply
    """

    band: str
    x_m: Array
    y_m: Array
    zone: tuple[float, float, float, float]
    rows: tuple[int, int]
    columns: tuple[int, int]
    pixel_m: float
    labels: tuple[str, ...]
    family: NDArray[np.int64]
    order: NDArray[np.int64]
    arms: NDArray[np.int64]
    transmission: Array
    transmission_error: Array
    transmission_interpolation: float
    pairs: tuple[FieldPair, ...]
    sigma0: float
    shadows: tuple[Shadow, ...]
    views: tuple[SceneView, ...]
    left_out: float
    left_out_baseline: float
    psf: NominalPsf | None = None

    @property
    def x_pixels(self) -> Array:
        """(C,) centres of the zone's columns, m."""
        return np.asarray(self.zone[0] + (np.arange(self.columns[1] - self.columns[0]) + 0.5) * self.pixel_m)

    @property
    def y_pixels(self) -> Array:
        """(R,) centres of the zone's rows, m."""
        return np.asarray(self.zone[2] + (np.arange(self.rows[1] - self.rows[0]) + 0.5) * self.pixel_m)

    @property
    def nominal(self) -> FieldPair:
        """The pair of both nominal beams."""
        return next(pair for pair in self.pairs if {pair.m, pair.l} == {0, 1})

    def strength(self, pair: FieldPair) -> Array:
        """(Y, X) √(t_m t_l) of a pair at the nodes; between them it is a polynomial, too."""
        return np.sqrt(self.transmission[pair.m] * self.transmission[pair.l])

    def to(self, y: Array, x: Array) -> tuple[Array, Array]:
        """Matrices (len(y), Y) and (X, len(x)) that take values at the nodes to the grid y × x."""
        return chebyshev.interpolation_matrix(self.y_m, y), chebyshev.interpolation_matrix(self.x_m, x).T


def at_sigma(pair: FieldPair, sigma: float) -> tuple[Complex, Array]:
    """gamma (Y, X) and opd (Y, X) of a pair at one wavenumber, between its own."""
    if len(pair.sigma) == 1:
        return pair.gamma[0], pair.opd_m[0]
    row = chebyshev.interpolation_matrix(pair.sigma, np.array([sigma]))[0]
    return np.tensordot(row, pair.gamma, 1), np.tensordot(row, pair.opd_m, 1)


def frozen(
    coherency: Coherency, sigma0: float, zone: tuple[float, float, float, float], rows: tuple[int, int],
    columns: tuple[int, int], pixel_m: float, origin_y: float = 0.0, band: str = "",
) -> FringeField:  # fmt: skip
    """The fringe field of one field point held all over a zone, as the paper's one-dimensional generator does.

    Powers and contrasts are those of ``coherency``, path differences go on along their slopes from y = origin_y (m);
    nothing changes across track, and every family images the scene onto itself.
    """
    x, y = chebyshev.nodes(1, *zone[:2]), chebyshev.nodes(2, *zone[2:])
    ones = np.ones((1, 2, 1))
    pairs = tuple(
        FieldPair(
            p.m, p.l, p.sigma, p.gamma[:, None, None] * ones,
            p.opd_m[:, None, None] + p.slope * (y - origin_y)[None, :, None], float(p.error.max()), 0.0,
        )
        for p in coherency.pairs
    )  # fmt: skip
    power, error = coherency.transmission[:, None, None] * ones, coherency.transmission_error
    return FringeField(
        band, x, y, zone, rows, columns, pixel_m, coherency.labels, coherency.family, coherency.order,
        np.zeros((len(coherency.labels), 2), dtype=np.int64), power,
        error if len(error) else np.zeros(len(coherency.labels)), 0.0, pairs, sigma0, (), (), 0.0, 0.0,
    )  # fmt: skip
