"""Without finufft the package imports, and the method names the extra."""

import pickle
import sys

import pytest

from cgi_wave.errors import MissingPackageError
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods import nufft
from cgi_wave.wave.methods.patch import Patch


def test_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "finufft", None)
    nufft._plan.cache_clear()
    m, l = HopkinsPair().pupil_fields()  # noqa: E741
    assert "cgi-wave[nufft]" in nufft.Nufft().supports(m, l, 1.0)
    with pytest.raises(MissingPackageError, match=r"cgi-wave\[nufft\]") as info:
        nufft.amplitude(m, Patch((-4, -4), (8, 8), (0.2, 0.2)), 1.0)
    assert pickle.loads(pickle.dumps(info.value)).extra == "nufft"
