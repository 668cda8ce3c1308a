"""Variants of a format, or of the bytes, that would make refused bytes a frame: one file for each kind of guess."""
