"""pytest's importlib mode puts no test folder on the path; the small instruments stand with the tests of rays."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / "rays")]
