"""Which clearances bound a beam, beside their definition on points much denser than rays."""

import numpy as np
import pytest

from cgi_wave.kernels.bounds import near_zero, same_disc
from cgi_wave.rays.clearances import AMPLE, LIMITING, bounding_rows, limiting
from cgi_wave.rays.disc import disc


def circles(p, seed, count=12):
    """Clearances (K, N) of circles of random place and radius at points p (N, 2), some of which cut the unit disc."""
    rng = np.random.default_rng(seed)
    centre, radius = rng.normal(0.0, 0.5, (count, 1, 2)), rng.uniform(0.6, 2.0, (count, 1))
    return 1.0 - ((p - centre) ** 2).sum(axis=2) / radius**2


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("p", [disc(400), 0.7 * disc(400) + 0.2, disc(400)[::2]], ids=["disc", "moved", "part"])
def test_what_is_kept_bounds_the_same_light_and_each_row_of_it_has_an_edge(p, seed):
    """Rows that went are positive where those that stayed are, and each that stayed is near 0 where the others are not
    far below."""
    clearance = circles(p, seed)
    rows = bounding_rows(clearance, p)
    middle = 0.5 * (p.min(axis=0) + p.max(axis=0))
    reach = np.sqrt(((p - middle) ** 2).sum(axis=1)).max()
    rng = np.random.default_rng(1)
    angle, far = rng.uniform(0.0, 2.0 * np.pi, 40_000), np.sqrt(rng.uniform(0.0, 1.0, 40_000))
    dense = circles(middle + reach * far[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), seed)
    kept = dense[rows].min(axis=0)
    assert (dense[:, kept > LIMITING] > 0.0).all()
    for row in rows:
        others = dense[[k for k in rows if k != row]].min(axis=0, initial=np.inf)
        assert len(rows) == 1 or (dense[row] < 1.2 * LIMITING)[others > -1.2 * LIMITING].any()
    assert np.array_equal(limiting(clearance[:, None], p)[:, 0], clearance[rows])


def test_where_nothing_cuts_the_nearest_is_kept():
    p = disc(400)
    clearance = 1.0 - (p**2).sum(axis=1) / np.array([[9.0], [4.0], [6.0]])
    assert bounding_rows(clearance, p).tolist() == [1]
    taken, rows = near_zero(clearance, AMPLE)
    assert rows.tolist() == [1] and np.array_equal(taken, clearance[[1]])


def test_like_apertures_are_one():
    """The stop and its image: the same row twice, and a third one elsewhere."""
    p = disc(400)
    one, other = 1.0 - (p**2).sum(axis=1) / 0.8, 1.0 - ((p - [0.7, 0.0]) ** 2).sum(axis=1)
    assert len(bounding_rows(np.array([one, one + 1e-8, other]), p)) == 2


def test_points_of_a_disc_are_known_wherever_it_lies():
    p = 3e-3 * disc(280) + [0.1, -0.2]
    assert same_disc(p, disc(280))
    p = p.copy()
    p[17, 0] += 1e-6
    assert not same_disc(p, disc(280))
