"""Slow computations of the overlap of two circular pupils that share no code with the package or with each other."""
