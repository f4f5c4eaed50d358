"""Parts of scripts/design_reference.py."""
