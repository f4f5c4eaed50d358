"""Scripts run as their readers would run them, and public names lead somewhere without making the import heavy."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import cgi_wave

SCRIPT = Path(__file__).parents[1] / "scripts" / "band_analysis.py"


def test_band_analysis_is_short_and_uses_public_names_only():
    text = SCRIPT.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert re.findall(r"^(?:from|import) (?!argparse|pathlib|matplotlib).*", text, re.MULTILINE) == [
        "import cgi_wave as cw"
    ]
    assert set(re.findall(r"\bcw\.(\w+)", text)) <= set(cgi_wave.__all__)


def test_band_analysis_finds_what_the_strongest_ghosts_do(tmp_path, capsys):
    spec = importlib.util.spec_from_file_location("band_analysis", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    # The filter's and the detector's ghosts only; a loose tolerance keeps the pairs few.
    found = module.main(["NIR", "--floor", "4e-3", "--tolerance", "1e-3", "--out", str(tmp_path)])
    plt.close("all")
    # Filter face (R/2)(1 − J/2), at most 2.5 %, and the refocused detector ghost ρτ²/4 = 1.1 % to ρτ²/2 = 2.3 %.
    assert 0.02 < found["offset_over_baseline"] < 0.05
    assert -0.03 < found["parasitic_over_modulation"] < 0.0
    exact = 1 - (1 + found["parasitic_over_modulation"]) / (1 + found["offset_over_baseline"])
    assert found["nma_error"] == pytest.approx(exact, rel=1e-9)
    assert {path.name for path in tmp_path.iterdir()} == {"NIR-psi.png", "NIR-contrast.png"}
    printed = capsys.readouterr().out
    contrasts = re.findall(r"^(\w+):r arms .* \|γ\| = (\S+) ± (\S+), Eq\. 4: (\S+)$", printed, re.MULTILINE)
    assert {name for name, *_ in contrasts} == {"filter_front", "detector"} and len(contrasts) == 8
    assert all(0.0 < float(gamma) < 1.0 and float(error) < 1e-3 for _, gamma, error, _ in contrasts)


@pytest.mark.parametrize("name", cgi_wave.__all__)
def test_every_public_name_leads_somewhere(name):
    found = getattr(cgi_wave, name)
    assert name == "__version__" or (callable(found) and found.__name__ == name)
    assert name in dir(cgi_wave)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'analyze'"):
        cgi_wave.analyze  # noqa: B018


def test_import_is_light():
    script = (
        "import sys, cgi_wave; print(sorted({'numpy', 'scipy', 'numba', 'matplotlib', 'click'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
