"""A first protocol file out of a C header's packed structs and enums. Needs no C compiler."""

from wirebond.import_.protocol_file import Imported, import_header

__all__ = ["Imported", "import_header"]
