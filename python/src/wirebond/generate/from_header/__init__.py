"""A first protocol file out of a C header's packed structs and enums. Needs no C compiler."""

from wirebond.generate.from_header.protocol_file import Imported, import_header

__all__ = ["Imported", "import_header"]
