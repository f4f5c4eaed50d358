"""pytest's importlib mode puts no test folder on the path; what tests of scenes share stands beside them."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent)]
