"""Table 1: the paper's own figures against the exact ratio, and the column's arithmetic."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from cgi_wave.budget.table1 import PRINTED, ROWS, format_table1, table1
from cgi_wave.errors import InputError
from cgi_wave.fringes.nma import Estimate, nma_error_exact, nma_error_linear


@pytest.mark.parametrize(
    ("band", "exact"), [("VIS", 0.0354), ("NIR", 0.0327), ("SWIR1-CO2", 0.0281), ("SWIR2", 0.0328)]
)
def test_printed_columns_follow_the_exact_ratio_and_not_the_linear_form(band, exact):
    column = PRINTED[band]
    o, m = column.offset_over_baseline[0], column.parasitic_over_modulation[0]
    assert nma_error_exact(m, o) == pytest.approx(exact, abs=6e-5)
    assert abs(nma_error_exact(m, o) - column.nma_error) < 5e-4
    assert abs(nma_error_linear(m, o) - column.nma_error) > abs(nma_error_exact(m, o) - column.nma_error)


def test_printed_ch4_column_does_not_fit_unless_a_sign_was_lost():
    column = PRINTED["SWIR1-CH4"]
    o, m = column.offset_over_baseline[0], column.parasitic_over_modulation[0]
    assert nma_error_exact(m, o) == pytest.approx(0.0251, abs=6e-5)
    assert abs(nma_error_exact(m, o) - column.nma_error) > 0.014
    assert nma_error_exact(-0.007, o) == pytest.approx(0.0398, abs=2e-4)


def part(o, m, error):
    return SimpleNamespace(
        offset_over_baseline=Estimate(o, error),
        parasitic_over_modulation=Estimate(m, 2 * error),
        nma_error=Estimate(nma_error_exact(m, o), 3 * error),
        nma_error_linear=Estimate(nma_error_linear(m, o), 3 * error),
    )


def results():
    fields = [(0.030, -0.001, 0.041, 0.001), (0.034, -0.003, 0.047, 0.002), (0.026, 0.001, 0.044, 0.003)]
    one = Estimate(0.4, 1e-5)
    nominal = SimpleNamespace(modulation=one, baseline=one, nma=one)
    return [
        SimpleNamespace(nominal=nominal, coherent=part(a, b, a / 300), paper=part(c, d, 1e-4)) for a, b, c, d in fields
    ]


def test_column_has_mean_spread_and_the_largest_error_bar():
    column = table1("NIR", results())
    assert column["offset_over_baseline"] == pytest.approx(
        {"mean": 0.030, "spread": np.sqrt(2 * 0.004**2 / 3), "error": 0.034 / 300}
    )
    assert column["parasitic_over_modulation"]["mean"] == pytest.approx(-0.001)
    exact = [1 - (1 + m) / (1 + o) for o, m in [(0.030, -0.001), (0.034, -0.003), (0.026, 0.001)]]
    assert column["nma_error"]["mean"] == pytest.approx(np.mean(exact))
    assert column["nma_error_linear"]["mean"] == pytest.approx(0.031)
    assert column["paper_bookkeeping"]["offset_over_baseline"]["mean"] == pytest.approx(0.044)
    assert column["printed"]["offset_over_baseline"] == {"mean": 0.034, "spread": 0.005}
    assert column["printed"]["nma_error"]["mean"] == 0.0328
    assert column["fields"] == 3
    assert json.loads(json.dumps(column)) == column


def test_every_printed_number_has_a_sentence_with_the_results_own_figures():
    column = table1("NIR", results(), families={"filter:r": 0.02, "lens:r": 1e-4, "plate:r": 0.015})
    rows = column["why_rows"]
    assert set(rows) == set(ROWS) and column["why"] == " ".join(rows.values())
    offset, modulation, error = (rows[row] for row in ROWS)
    assert "smaller by 0.0040" in offset and "4.40%" in offset and "3.00%" in offset
    assert "filter:r 2.00%, plate:r 1.50%, lens:r 0.01%" in offset
    assert "smaller by 0.0012" in modulation and "give +0.0020" in modulation and "negligible, -0.0030" in modulation
    assert "smaller by" in error and "as the printed one does" in error
    assert all(sentence.endswith(".") and sentence.count(". ") <= 0 for sentence in rows.values())


def test_a_printed_number_that_does_not_follow_is_named():
    assert "gives 0.0251 for the printed ones" in table1("SWIR1-CH4", results())["why_rows"]["nma_error"]


def test_why_belongs_to_printed_figures_and_can_be_given():
    given = table1("SWIR2", results(), why="another instrument")
    assert given["why"] == "another instrument" and given["why_rows"] is None
    other = table1("O2B", results())
    assert other["printed"] is None and other["why"] is None and other["why_rows"] is None
    with pytest.raises(InputError, match="no field"):
        table1("NIR", [])


def test_text_holds_every_row_in_three_columns():
    text = format_table1({"NIR": table1("NIR", results()), "O2B": table1("O2B", results())})
    row = next(line for line in text.splitlines() if line.startswith("NIR") and " O/B" in line)
    assert "+0.0300 ± 0.0033" in row and "+0.0440" in row and "+0.0340 ± 0.0050" in row
    assert table1("NIR", results())["why"] in text
    assert len(text.splitlines()) == 1 + 5 + 4
