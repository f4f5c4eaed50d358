"""Zemax and CODE V lens files made into instrument files; what was substituted, and what is refused."""
