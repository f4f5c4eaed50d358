"""Partially scanned interferograms and what is retrieved from them."""
