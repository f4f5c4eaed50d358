"""Errors cross process borders whole: field points are computed in worker processes."""

import pickle

import pytest

from cgi_wave.errors import EmptyBeamError, FoldedFieldError, InputError, MethodLimitError

CASES = [
    InputError("a.toml", "band.NIR", 3, "is odd", "use an even one"),
    MethodLimitError("panels", "4 nodes", 2.5, "ask for less"),
    EmptyBeamError("no ray"),
    FoldedFieldError("fold"),
]


@pytest.mark.parametrize("error", CASES, ids=lambda error: type(error).__name__)
def test_an_error_survives_a_process_border(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)
