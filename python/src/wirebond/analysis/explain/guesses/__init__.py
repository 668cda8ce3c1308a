"""Changes to the file, or to the bytes, that would make refused bytes a frame: one file for each kind of guess."""
