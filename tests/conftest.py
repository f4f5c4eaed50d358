"""What every test shares: no display, and property tests that neither time out nor roll other dice each time."""

import os

from hypothesis import settings

os.environ["MPLBACKEND"] = "Agg"
settings.register_profile("steady", deadline=None, derandomize=True)
settings.load_profile("steady")
