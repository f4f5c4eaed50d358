"""The grid of nodes for smooth layers: which layers each grid could take, and the one that takes most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cgi_wave.fringes import smooth
from cgi_wave.fringes.blur_choice import CELLS
from cgi_wave.fringes.cells import coarse
from cgi_wave.fringes.imaging import Ground, Seen, Span
from cgi_wave.fringes.layer import Zone
from cgi_wave.fringes.pattern import Layer
from cgi_wave.fringes.ways import Placed, Samples, SmoothWay, View, flatness, sampled_pixels, truth, turn_of

Array = NDArray[np.float64]
Real = NDArray[np.floating]


class Grids:
    """The grids of nodes, and which layers each could take."""

    def __init__(
        self, layers: Sequence[Layer], views: Sequence[View], steps: Sequence[int], ground: Ground, zone: Zone,
        span: Span, budget: float, dtype: type,
    ) -> None:  # fmt: skip
        self.ground, self.zone, self.span, self.budget, self.dtype = ground, zone, span, budget, dtype
        self.grids = [smooth.grid(zone.shape, pitch, dtype) for pitch in sorted(smooth.PITCHES)
                      if 4 * pitch <= max(zone.shape)]  # fmt: skip
        self.turns: dict[int, Real] = {}
        self.pixels = sampled_pixels(zone.shape)
        self.found: dict[int, dict[int, tuple[SmoothWay, Placed]]] = {}
        able = [
            number for number, (layer, view) in enumerate(zip(layers, views, strict=True))
            if number and layer.view is not None and view.how.method != "nothing"
            and min(*zone.shape, *ground.maps.shape[1:]) >= 4
        ]  # fmt: skip
        envelopes = smooth.Envelopes(zone) if able and self.grids else None
        for number in able if envelopes is not None else ():
            assert envelopes is not None
            fits = [envelopes.fit(part, 0.5 * budget / len(layers) / ground.scale) for part in layers[number].pattern]
            terms = [fit for fit in fits if fit is not None]
            if len(terms) == len(fits):
                view, part = self._seen(views[number], steps[number], (1.0 - CELLS) * budget / len(able))
                self.found[number] = self._tried(layers[number], terms, envelopes, view, part)

    def best(self) -> tuple[dict[int, SmoothWay], dict[int, Placed]]:
        """As many layers as go onto one grid with their errors together within the budget: the coarsest of those that
        take as many."""
        best: tuple[int, list[int]] = 0, []
        for pitch in smooth.PITCHES:
            errors = sorted((found[pitch][1].error, number) for number, found in self.found.items() if pitch in found)
            total = np.cumsum([error for error, _ in errors])
            taken = [number for (_, number), so_far in zip(errors, total, strict=True) if so_far <= self.budget]
            if len(taken) > len(best[1]):
                best = pitch, taken
        pitch, taken = best
        chosen = {number: self.found[number][pitch] for number in taken}
        return {number: way for number, (way, _) in chosen.items()}, {
            number: one for number, (_, one) in chosen.items()
        }

    def _seen(self, view: View, step: int, allowed: float) -> tuple[View, Seen]:
        """The layer's image by cells of ``step``, or smaller ones if reading between them errs by more than allowed."""
        assert view.of is not None
        while step > 1:
            kernel = coarse(view.of.kernel, step)
            error = float(view.strength @ kernel.error(self.ground.cells(step)))
            by_cells = replace(view, by_cells=kernel, error=error)
            part = by_cells.seen(self.ground, self.zone, self.span, self.dtype)
            if float(view.strength @ part.reading(4)) <= allowed:
                return by_cells, part
            step //= 2
        return view, view.seen(self.ground, self.zone, self.span, self.dtype)

    def _tried(
        self, layer: Layer, terms: Sequence[tuple[tuple[int, int], Array]], envelopes: smooth.Envelopes, view: View,
        part: Seen,
    ) -> dict[int, tuple[SmoothWay, Placed]]:  # fmt: skip
        """The layer on every grid on which its error is within the budget, finest first."""
        found: dict[int, tuple[SmoothWay, Placed]] = {}
        dark = list(self.zone.dark)
        uniform = layer.pattern.sum(axis=0)
        samples = Samples.of(layer.pattern, self.pixels)
        expected = truth(view, part, samples, self.zone, self.span, self.ground)
        for where in self.grids:
            if where.pitch not in self.turns:
                self.turns[where.pitch] = turn_of(self.zone, where, self.dtype)
            turn = self.turns[where.pitch]
            envelope: Real = np.array(
                [envelopes.on_nodes(*fit, where, one[dark]) for fit, one in zip(terms, layer.pattern, strict=True)],
                dtype=self.dtype,
            )
            least = 1e-4 * self.budget / len(envelope)
            if np.abs(envelope[:, 1:]).sum(axis=1, initial=0.0).max() * self.ground.scale < least:
                envelope = envelope[:, :1].copy()
            flat = flatness(envelope, uniform, self.zone, where, turn, self.dtype)
            way = SmoothWay(view, where, envelope, flat, samples)
            placed = way.placed(part, self.ground, self.zone, turn, expected, self.dtype)
            if placed.error > self.budget:
                break
            found[where.pitch] = way, placed
        return found
