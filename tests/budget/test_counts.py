"""Counts of ghosts: made-up rows whose counts one can see."""

from cgi_wave.budget.counts import count_ghosts, counts_text

ROWS = [
    {"label": "detector:r arms 1-1", "order": 1, "transmission": 2e-3, "transmission_fields": [3e-3, 1e-3]},
    {"label": "detector:r arms 1-2", "order": 1, "transmission": 4e-6, "transmission_fields": [8e-6, 0.0]},
    {"label": "lens:r mirror:t arms 1", "order": 1, "transmission": 1e-5, "transmission_fields": [0.0, 2e-5]},
    {"label": "lens:r detector:r arms 2 #2", "order": 2, "transmission": 1e-7, "transmission_fields": [1e-7, 1e-7]},
]


def test_counts_by_order_field_and_first_surface():
    counts = count_ghosts(ROWS)
    assert counts["above"] == 1e-5
    assert counts["total"] == {"all": 4, "above": 1}
    assert counts["by_order"] == {"1": {"all": 3, "above": 1}, "2": {"all": 1, "above": 0}}
    # At the second point the lens is seen strongly, and the cancelled pair of arms not at all.
    assert counts["by_field"] == [{"all": 3, "above": 1}, {"all": 3, "above": 2}]
    assert counts["by_first_surface"] == {"detector": {"all": 2, "above": 1}, "lens": {"all": 2, "above": 0}}
    for part in ("by_order", "by_first_surface"):
        assert sum(count["all"] for count in counts[part].values()) == len(ROWS)


def test_text_gives_strong_and_all():
    text = counts_text(count_ghosts(ROWS))
    assert "1/4; order 1: 1/3, order 2: 0/1" in text
    assert "at the field points: 1/3, 2/3" in text
    assert "detector 1/2, lens 0/2" in text


def test_no_ghosts_are_no_counts():
    counts = count_ghosts([])
    assert counts["total"] == {"all": 0, "above": 0} and counts["by_field"] == []
    assert "0/0" in counts_text(counts)
