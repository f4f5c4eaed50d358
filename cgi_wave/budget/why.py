"""Why a reconstructed instrument need not land on the paper's figures: one sentence for each printed number.

The sentences are made of the result's own figures, so that they hold for whatever instrument is analysed.
"""

from __future__ import annotations

from collections.abc import Mapping

from cgi_wave.fringes.nma import nma_error_exact

#: Reflections named, of those that carry most power.
NAMED = 4
#: A printed NMA error that the exact ratio of the printed figures misses by more than this does not follow from them.
FOLLOWS = 1e-3
#: What the paper leaves open about a band, beyond lens data, coatings and distances.
OPEN = {"VIS": ", and the paper states neither gas, filter nor path difference for VIS"}


def why_rows(
    band: str,
    ours: Mapping[str, float],
    paper_bookkeeping: Mapping[str, float],
    printed: Mapping[str, float],
    families: Mapping[str, float] | None = None,
) -> dict[str, str]:
    """A sentence each for ``offset_over_baseline``, ``parasitic_over_modulation`` and ``nma_error``.

    ours, paper_bookkeeping, printed: means of the rows, coherent, with powers added as in the paper, and as printed.
    families: power, relative to the nominal beams, of all ghosts with the same reflections, by the names of those.
    """
    o, m, error = "offset_over_baseline", "parasitic_over_modulation", "nma_error"
    largest = sorted((families or {}).items(), key=lambda item: -item[1])[:NAMED]
    named = ", ".join(f"{name} {power:.2%}" for name, power in largest)
    exact = nma_error_exact(printed[m], printed[o])
    obeys = (
        "as the printed one does"
        if abs(exact - printed[error]) < FOLLOWS
        else f"which gives {exact:.4f} for the printed ones, not what is printed"
    )
    return {
        o: (
            f"Ours is {_compared(ours[o] - printed[o])} since the ghosts of this instrument carry "
            f"{paper_bookkeeping[o]:.2%} of the nominal baseline{f' ({named}, …)' if named else ''}, of which "
            f"{ours[o]:.2%} remain once the arm pairs of each reflection interfere; faces, coatings and distances of "
            "the paper's instrument are not public."
        ),
        m: (
            f"Ours is {_compared(ours[m] - printed[m])}: ghost–nominal pairs, all that the paper keeps, give "
            f"{paper_bookkeeping[m]:+.4f}, and pairs of ghosts off one face, which it drops as negligible, "
            f"{ours[m] - paper_bookkeeping[m]:+.4f}; how much of these has the nominal frequency hangs on the face's "
            f"distance from the detector, which is not public for the paper's{OPEN.get(band, '')}."
        ),
        error: (
            f"Ours is {_compared(ours[error] - printed[error])} and follows from the two rows above by the exact ratio "
            f"1 − (1 + M*/M)/(1 + O/B), {obeys}: a larger baseline offset and a modulation that falls both add to it."
        ),
    }


def _compared(difference: float) -> str:
    return f"{'larger' if difference > 0 else 'smaller'} by {abs(difference):.4f}"
