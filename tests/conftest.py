"""What every test shares: no display, and property tests that neither time out nor roll other dice each time."""

import hashlib
import os
from pathlib import Path

from hypothesis import settings

# Numba keeps compiled code by the file of a function, and does not notice a change in a file that it calls into: here a
# folder per state of all kernels.
_ROOT = Path(__file__).parents[1]
_KERNELS = b"".join(file.read_bytes() for file in sorted((_ROOT / "cgi_wave" / "kernels").glob("*.py")))
_CACHE = _ROOT / ".pytest_cache" / f"numba-{hashlib.sha256(_KERNELS).hexdigest()[:12]}"
os.environ.setdefault("NUMBA_CACHE_DIR", str(_CACHE))

os.environ["MPLBACKEND"] = "Agg"
settings.register_profile("steady", deadline=None, derandomize=True)
settings.load_profile("steady")
