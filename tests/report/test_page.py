"""The page shows every number it is given, escapes what comes from files, and fetches nothing."""

import re
import shutil
import subprocess
from html.parser import HTMLParser

import jinja2
import pytest

from cgi_wave.report import page

GHOST = {
    "label": "detector:r <b> & filter:r",
    "path": "filter detector:r <b> & filter:r",
    "order": 1,
    "transmission": 2.5e-3,
    "rms_x_m": 1.5e-4,
    "rms_y_m": 2.5e-4,
    "contrast_eq4": 0.05,
    "contrast": 0.0123,
    "contrast_error": 1e-6,
    "method": "panels",
    "contrast_uniform": 0.2,
    "contrast_uniform_error": 1e-5,
    "opd_m": 1.33e-3,
    "fringes": 10.0,
}


COST = {column.key: 0.0123 for column in page.SURFACE_COLUMNS} | {
    "name": "plate & <face>",
    "coating": "ar",
    "ghosts": 7,
    "contrast": None,
}
TOTAL = {"share_offset": 0.0345, "share_modulation": -0.0067, "share_nma": 0.0411}


def entry(mean, spread):
    return {"mean": mean, "spread": spread, "error": 1e-6}


ROWS = dict.fromkeys(page.TABLE1_ROWS, entry(0.0123, 0.0004))
DOCUMENT = {
    "title": "Ghosts of <instrument>",
    "lead": "One sentence.",
    "provenance": {"version": "0.1.0", "libraries": {"numpy": "2"}},
    "files": ["summary.json", "NIR-ghosts.csv"],
    "pictures": [{"file": "layout.png", "caption": "Layout", "wide": True}],
    "bands": [
        {
            "name": "NIR",
            "about": "764 nm.",
            "table1": {
                **ROWS,
                "paper_bookkeeping": ROWS | {"offset_over_baseline": entry(0.0456, 0.0)},
                "printed": {"offset_over_baseline": {"mean": 0.034, "spread": None}},
                "fields": 5,
                "why": "Coherence & <sums>.",
                "why_rows": {"offset_over_baseline": "Coherence & <sums>."},
            },
            "ghosts": [GHOST, GHOST | {"label": "L1", "contrast": None, "contrast_error": None}],
            "costs": {"surfaces": [COST], "families": [], "total": TOTAL},
            "pictures": [{"file": "NIR-psi.png", "caption": "PSI", "wide": False}],
            "plan": "kept 1 < 2",
        }
    ],
}


WIDTH = len(page.GHOST_COLUMNS)


class Reader(HTMLParser):
    """Open tags, links and cells of a page; raises when tags do not nest."""

    VOID = frozenset({"meta", "link", "img", "br"})

    def __init__(self):
        super().__init__()
        self.stack, self.links, self.cells, self.keys, self.ids = [], [], [], [], []

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.links += [attrs[name] for name in ("src", "href") if name in attrs]
        self.ids += [attrs["id"]] if "id" in attrs else []
        if tag not in self.VOID:
            self.stack.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")
            self.keys.append(attrs.get("data-key"))

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag

    def handle_data(self, data):
        if {"td", "th"} & set(self.stack):
            self.cells[-1] += data


@pytest.fixture(scope="module")
def html():
    return page.render(DOCUMENT)


@pytest.fixture(scope="module")
def read(html):
    reader = Reader()
    reader.feed(html)
    assert reader.stack == []
    return reader


def test_numbers_are_shown_in_the_unit_of_the_heading(read):
    cells = dict(zip(read.cells[-3 * WIDTH : -2 * WIDTH], read.cells[-2 * WIDTH : -WIDTH], strict=True))
    assert cells["ghost"] == GHOST["label"] + GHOST["path"]  # the path is folded away below the label
    assert cells["power / % of nominal"] == "0.25"
    assert (cells["RMS x / µm"], cells["RMS y / µm"], cells["OPD / mm"]) == ("150", "250", "1.33")
    assert cells["contrast |γ|"] == "0.0123"


def test_what_was_not_computed_is_a_dash_with_no_key(read):
    column = [column.key for column in page.GHOST_COLUMNS].index("contrast")
    assert (read.cells[-WIDTH:][column], read.keys[-WIDTH:][column]) == ("–", "")
    assert read.keys[-2 * WIDTH : -WIDTH][column] == "0.0123"


def test_table1_shows_both_book_keepings_the_print_and_the_reason(read, html):
    row = read.cells.index(page.TABLE1_ROWS["offset_over_baseline"])
    assert read.cells[row + 1 : row + 4] == [
        "0.01230 ± 0.00040 (error 1e-06)",
        "0.04560 ± 0.00000 (error 1e-06)",
        "0.03400",
    ]
    row = read.cells.index(page.TABLE1_ROWS["nma_error_linear"])
    assert read.cells[row + 3] == "–"
    assert "Coherence &amp; &lt;sums&gt;." in html
    assert "over 5 field points" in html


def test_a_band_that_the_paper_does_not_have_has_no_printed_column_values():
    band = DOCUMENT["bands"][0]
    table1 = band["table1"] | {"printed": None, "why": None, "why_rows": None}
    html = page.render(DOCUMENT | {"bands": [band | {"table1": table1}]})
    assert "hy ours differ" not in html


def test_links_are_to_files_beside_the_page_or_places_on_it(html, read):
    for link in read.links:
        assert link == "data:," or link[1:] in read.ids or re.fullmatch(r"[\w.-]+", link), link
    assert "http" not in html and "@import" not in html and "url(" not in html


def test_words_from_files_are_escaped(html):
    assert "<title>Ghosts of &lt;instrument&gt;</title>" in html
    assert "kept 1 &lt; 2" in html
    assert 'title="filter detector:r &lt;b&gt; &amp; filter:r"' in html
    assert "<p>filter detector:r &lt;b&gt; &amp; filter:r</p>" in html


def test_a_missing_part_is_an_error_not_a_gap():
    with pytest.raises(jinja2.UndefinedError):
        page.render({key: value for key, value in DOCUMENT.items() if key != "files"})


@pytest.mark.parametrize(
    ("mean", "spread", "text"),
    [
        (0.0, 0.0, "0.00000 ± 0.00000"),
        (3e-4, 5e-4, "3.00e-04 ± 5.00e-04"),
        (-0.0071, 0.001, "-0.00710 ± 0.00100"),
        (0.0355, None, "0.03550"),
    ],
)
def test_mean_and_spread(mean, spread, text):
    assert page.mean_spread({"mean": mean, "spread": spread}) == text


@pytest.mark.skipif(shutil.which("node") is None, reason="no JavaScript engine here")
def test_the_script_is_valid_javascript(html, tmp_path):
    script = tmp_path / "page.js"
    script.write_text(re.search(r"<script>(.*)</script>", html, re.DOTALL)[1])
    subprocess.run(["node", "--check", str(script)], check=True)


def test_what_surfaces_cost_stands_in_per_cent_and_adds_up_in_words():
    text = page.render(DOCUMENT)
    assert "plate &amp; &lt;face&gt;" in text
    assert all(f"{number} %" in text for number in ("3.450", "-0.670", "4.110"))
    shown = [column.text(COST) for column in page.SURFACE_COLUMNS]
    assert shown[:5] == ["plate & <face>", "ar", "7", "1.23", "1.23"] and "–" in shown
    assert text.count(">1.23</td>") >= shown.count("1.23")
