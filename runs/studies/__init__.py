"""Experiments as data: one file, one value named `STUDY`."""
