"""Pupil fields, overlap contrast and point-spread functions."""
