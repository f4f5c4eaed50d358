"""What a Monte-Carlo walk leaves behind: where the light went, how it lies on the detector, by which paths it came."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cgi_wave.kernels.walk import UNIT

Array = NDArray[np.float64]

Kind = Literal["detector", "absorbed", "rim", "back", "left", "depth", "beyond table"]
#: Kinds of entries that make up each of the ledger's five sums.
SUMS: Mapping[str, tuple[Kind, ...]] = {
    "detector": ("detector",),
    "absorbed": ("absorbed",),
    "vignetted": ("rim", "back"),
    "left": ("left",),
    "pruned": ("depth", "beyond table"),
}


@dataclass(frozen=True)
class Share:
    """A share of the light through the entrance pupil, its standard error, and how many rays had part in it."""

    share: float
    error: float
    count: int


@dataclass(frozen=True)
class Entry(Share):
    """One line of the ledger. units: the exact share, in 2⁻⁵⁰ of a ray.

    kind: "detector" kept by the recording surface; "absorbed" by surface ``where`` (masks included); "rim" passed
    outside its aperture and met nothing else; "back" met it from a side that bounds nothing; "left" the system through
    space ``where``; "depth" was still on its way after the last allowed event; "beyond table": the table of its coating
    does not hold that angle.
    """

    kind: Kind
    where: str
    units: int


@dataclass(frozen=True)
class PathShare(Share):
    """Light that arrived on the detector by one path.

    path: as ``str(Path)``; a scattering is written ``name:s`` (transmitted) or ``name:rs`` (reflected), and such a path
    cannot be traced in sequence. label: its parasitic history and arms (twins share one), and where it was scattered.
    order: parasitic reflections; scattered: whether it was scattered on the way.
    """

    path: str
    label: str
    order: int
    scattered: bool


@dataclass(frozen=True, eq=False)
class Map:
    """Irradiance on the detector, W/m² per W through the entrance pupil.

    x (nx + 1,), y (ny + 1,): edges of the cells, m; irradiance, error (standard error), stray, stray_error (ny, nx);
    count (ny, nx): rays with part in it. stray: all that is not nominal, ghosts and scattered light.
    """

    x: Array
    y: Array
    irradiance: Array
    error: Array
    stray: Array
    stray_error: Array
    count: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Flux:
    """Where the light went: the ledger of a Monte-Carlo walk. Interference is not in it: powers add.

    entries: the ledger, line by line, largest first. arrived: light that met the detector, before its own reflection,
    by "nominal", "order 1", "order 2", "order 3 and more" and "scattered". paths: the strongest ways in. others: light
    that came by paths too many to be kept apart. radiance: of the source, W/m² per unit of projected solid angle (area
    of direction cosines) and W through the pupil; NaN for a single direction. rays, seed, sigma (1/m), split: what made
    it; events: surfaces met; total_reflections: how often a coated face reflected all beyond the critical angle.
    """

    instrument: str
    band: str
    source: str
    rays: int
    seed: int
    sigma: float
    split: float
    max_depth: int
    entries: tuple[Entry, ...]
    arrived: dict[str, Share]
    paths: tuple[PathShare, ...]
    others: float
    map: Map
    radiance: float
    events: int
    total_reflections: int

    @property
    def imbalance(self) -> int:
        """Input less the sum of the ledger, in units of 2⁻⁵⁰ of a ray: 0."""
        return self.rays * UNIT - sum(entry.units for entry in self.entries)

    def sum(self, name: str) -> float:
        """One of the ledger's five sums: detector, absorbed, vignetted, left or pruned."""
        return sum(entry.units for entry in self.entries if entry.kind in SUMS[name]) / (self.rays * UNIT)

    def at(self, kind: Kind, where: str) -> Share:
        """One line of the ledger; a share of 0 if it is not there."""
        for entry in self.entries:
            if entry.kind == kind and entry.where == where:
                return entry
        return Share(0.0, 0.0, 0)

    def document(self) -> dict[str, Any]:
        """Everything as plain data; the map's arrays as they are."""
        radiance = None if np.isnan(self.radiance) else self.radiance
        plain = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return plain | {
            "radiance": radiance,
            "sums": {name: self.sum(name) for name in SUMS},
            "imbalance": self.imbalance,
            "entries": [asdict(entry) for entry in self.entries],
            "arrived": {name: asdict(share) for name, share in self.arrived.items()},
            "paths": [asdict(path) for path in self.paths],
            "map": {name: getattr(self.map, name) for name in self.map.__dataclass_fields__},
        }


def share(units: int, square: float, count: int, rays: int) -> Share:
    """A share from its sums over rays: units, Σ(share of each ray)², number of rays with part in it."""
    mean = units / (rays * UNIT)
    variance = max(square / rays - mean * mean, 0.0) / max(rays - 1, 1)
    return Share(mean, float(np.sqrt(variance)), int(count))


def errors(mean: Array, square: Array, rays: int) -> Array:
    """Standard errors of shares, as in ``share``."""
    return np.asarray(np.sqrt(np.maximum(square / rays - mean * mean, 0.0) / max(rays - 1, 1)))
