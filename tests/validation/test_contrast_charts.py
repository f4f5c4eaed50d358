"""Charts of the contrast study: curves end where they should and say why; nothing on them can be mixed up."""

import time

import pytest

from cgi_wave.errors import MethodLimitError
from validation.contrast import CHARTED
from validation.contrast_charts import curve, regimes, time_to
from validation.contrast_plots import DASHED, OWN, style


def squares(n, before, spent):
    """Seconds expected of what grows as the square of n."""
    return spent * (n / (before or n)) ** 2


def test_a_curve_ends_before_the_point_that_takes_too_long():
    asked = []

    def ask(n):
        asked.append(n)
        time.sleep(1e-4 * n * n)
        return 1.0 / n

    found = curve(ask, (1, 2, 4, 8, 1000), 0.0, squares, 0.5, "samples")
    assert 1000 not in asked and found.left > 0.5 and "samples 1000 would take" in found.end
    assert [error for error, _ in found.points] == [1.0, 0.5, 0.25, 0.125]


def test_a_refusal_ends_a_curve_and_is_told():
    def ask(tol):
        if tol < 1e-3:
            raise MethodLimitError("grid", "too few samples", 4.0, "take four times as many")
        return tol

    found = curve(ask, (1e-2, 1e-3, 1e-4), 0.0, lambda *of: of[2], 1.0, "tolerance")
    assert len(found.points) == 2 and found.left == 0.0
    assert "0.0001" in found.end and "too few samples" in found.end
    assert curve(ask, (1e-2, 1e-3), 0.0, lambda *of: of[2], 1.0, "tolerance").end == "all asked for"


def test_time_to_an_error_is_where_a_curve_stays_below_it():
    points = [(1e-2, 1.0), (1e-5, 2.0), (1e-3, 3.0), (1e-4, 4.0), (1e-6, 5.0)]
    assert time_to(points, 1e-3) == 2.0 and time_to(points, 5e-4) == 4.0 and time_to(points, 1e-7) is None


def test_every_curve_has_a_colour_and_a_mark_of_its_own():
    names = [OWN, *CHARTED, *DASHED]
    looks = [style(name) for name in names]
    assert len({look["color"] for look in looks}) == len(names)
    assert style("unheard of")["color"] not in {look["color"] for look in looks}


@pytest.mark.parametrize(("largest", "count"), [(200.0, 24), (1e9, 36)])
def test_one_chart_for_each_regime(largest, count):
    assert len(regimes(largest)) == count
