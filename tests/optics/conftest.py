"""Let the tests of this folder import the small instruments of tests/rays."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "rays"))
