"""Part of a fringe field: the nominal beams and some families of ghosts, or some of them alone."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from cgi_wave.fringes.field import FringeField


def with_families(field: FringeField, families: Collection[int]) -> FringeField:
    """The field without ghosts of other families than these (none: the nominal beams alone), and without their pairs.

    What was not computed belongs to ghosts: without any, nothing was left out.
    """
    keep = np.flatnonzero((field.family == 0) | np.isin(field.family, list(families)))
    number = {int(old): new for new, old in enumerate(keep)}
    pairs = tuple(
        replace(pair, m=number[pair.m], l=number[pair.l])
        for pair in field.pairs
        if pair.m in number and pair.l in number
    )
    ghosts = len(keep) > 2
    return replace(
        field,
        labels=tuple(field.labels[k] for k in keep),
        family=field.family[keep],
        order=field.order[keep],
        arms=field.arms[keep],
        transmission=field.transmission[keep],
        transmission_error=field.transmission_error[keep],
        pairs=pairs,
        views=tuple(view for view in field.views if view.family in families),
        left_out=field.left_out if ghosts else 0.0,
        left_out_baseline=field.left_out_baseline if ghosts else 0.0,
    )
