"""Where the light of a pair's fringes comes from, beside the image that the frames give it.

Under light that varies over the ground a pair of beams makes 2√(t_m t_l) Re[exp(i…) Σ_d κ[d] L(x + d)], κ the mutual
kernel H_m H_l* in ground cells, complex, of sum γ. Frames take γ times one kernel for all light of a layer: the nominal
one for pairs with a nominal beam, the family's blur for pairs within a family. What κ has beyond that has the sum 0: it
shows where the scene varies, and is an error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cgi_wave.budget.nominal_psf import directions_to_pixels
from cgi_wave.budget.setting import Setting
from cgi_wave.errors import CgiWaveError
from cgi_wave.fringes.coherency import Pair
from cgi_wave.fringes.field import MutualKernel
from cgi_wave.rays.disc import disc, rim
from cgi_wave.rays.paths import Path
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.psf import Psf
from cgi_wave.wave.seen import cell_kernel, gathered, rays_of_pair, source_amplitude, source_pitch

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
#: Pupil points of a pair's rays, and cells along a side into which wide kernels are gathered.
POINTS, CELLS = 8000, 32
#: Pixels on each side of the middle at most for kernels by diffraction, and more than the beams' rays ask for.
WIDEST, ROOM = 64, 6


def mutual_kernels(
    setting: Setting, nominal: Path, x0: Array, fields: Mapping[int, PupilField], pairs: Sequence[Pair],
    family: NDArray[np.int64],
) -> list[MutualKernel]:  # fmt: skip
    """For each pair at the detector point x0 (m): what its kernel has beyond γ times the kernel that it is given.

    fields : pupil fields of the beams by number, in pupil space; family (B,) : 0 for the nominal beams. Pairs with a
    nominal beam by diffraction, pairs of one family by rays. Where neither can be made, only bounds.
    """
    seen = _Seen(setting, nominal, x0, fields)
    found = []
    for pair in pairs:
        groups = {int(family[pair.m]), int(family[pair.l])}
        bound = MutualKernel(np.zeros((1, 1), np.complex128), 1, 1.0 + float(np.abs(pair.gamma).max()))
        try:
            if 0 in groups:
                found.append(seen.sharp(pair))
            elif len(groups) == 1:
                found.append(seen.wide(pair))
            else:
                found.append(bound)
        except CgiWaveError:
            found.append(bound)
    return found


class _Seen:
    """Amplitudes over source directions of the beams of one point, made when needed."""

    def __init__(self, setting: Setting, nominal: Path, x0: Array, fields: Mapping[int, PupilField]) -> None:
        self.setting, self.fields = setting, fields
        self.sigma = setting.system.sigma0
        self.theta, self.to_pixels = directions_to_pixels(setting.system, nominal, x0)
        self.points = disc(POINTS)[: POINTS - rim(POINTS)]
        self._made: dict[tuple[int, int], Psf] = {}

    def sharp(self, pair: Pair) -> MutualKernel:
        """A pair with a nominal beam, by diffraction; its image is the nominal one."""
        *_, group = self._rays(pair)
        if {pair.m, pair.l} == {0, 1}:  # what the nominal pair lacks is part of the nominal PSF's error
            return MutualKernel(np.zeros((1, 1), np.complex128), 1, 0.0)
        widest = next(self.fields[number] for number in (pair.m, pair.l) if number > 1)
        *_, own, _ = rays_of_pair(widest, widest, self.sigma, self.points)
        half = min(int(np.ceil(np.abs((own - self.theta) @ self.to_pixels.T).max())) + ROOM, WIDEST)
        one, two = self._amplitude(pair.m, half), self._amplitude(pair.l, half)
        norm = float(np.sqrt(self._power(pair.m) * self._power(pair.l)))
        kernel = cell_kernel(one.field * two.field.conj(), one.x, one.y, self.to_pixels, half) / norm
        bright = self._amplitude(0, half).irradiance + self._amplitude(1, half).irradiance
        image = cell_kernel(bright, one.x, one.y, self.to_pixels, half)
        apart = np.asarray(kernel - kernel.sum() * image / image.sum(), np.complex128)
        missing = [max(1.0 - float(h.irradiance.sum()) * float(h.x[1] - h.x[0]) ** 2 / self._power(number), 0.0)
                   for number, h in ((pair.m, one), (pair.l, two))]  # fmt: skip
        return self._weighed(apart, 1, group, float(np.sqrt(missing[0] * missing[1])))

    def wide(self, pair: Pair) -> MutualKernel:
        """A pair of one family, by rays; its image is the family's blur, that of both beams together."""
        product, power, direction, group = self._rays(pair)
        if not len(product):
            return MutualKernel(np.zeros((1, 1), np.complex128), 1, 1.0)
        where = (direction - self.theta) @ self.to_pixels.T
        where = where - where.mean(axis=0)
        step = max(1, int(np.ceil(2.0 * np.abs(where).max() / CELLS)))
        half = int(np.ceil(np.abs(where).max() / step)) + 1
        total = power.sum(axis=0)
        kernel = gathered(product / np.sqrt(total[0] * total[1]), where / step, half)
        image = gathered((power / total).sum(axis=1), where / step, half)
        apart = np.asarray(kernel - kernel.sum() * image / image.sum(), np.complex128)
        return self._weighed(apart, step, group, 0.0)

    def _weighed(self, apart: Complex, step: int, group: Array, outside: float) -> MutualKernel:
        """Times the largest coherence of the light over the pair's path differences."""
        if len(group):
            low, high = float(group.min()), float(group.max())
            share = float(np.asarray(self.setting.envelope(np.array([low]), np.array([high])))[0])
        else:
            share = 1.0
        return MutualKernel(apart * share, step, (float(np.abs(apart).sum()) + outside) * share)

    def _rays(self, pair: Pair) -> tuple[Complex, Array, Array, Array]:
        return rays_of_pair(self.fields[pair.m], self.fields[pair.l], self.sigma, self.points)

    def _power(self, number: int) -> float:
        return float(self.fields[number].power_at(np.array([self.sigma]))[0])

    def _amplitude(self, number: int, half: int) -> Psf:
        if (number, half) not in self._made:
            reach = (half + 1.0) * float(np.abs(np.linalg.inv(self.to_pixels)).sum(axis=1).max())
            pitch = 1.5 * source_pitch(self.fields[0])  # Nyquist for |H|² of the nominal beam
            self._made[number, half] = source_amplitude(self.fields[number], self.theta, reach, pitch, self.sigma)
        return self._made[number, half]
