"""Compiled loops on plain arrays in SI units: no I/O, no classes."""
