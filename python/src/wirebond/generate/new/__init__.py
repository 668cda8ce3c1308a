"""A first protocol file: from a template, or from a C header."""

from wirebond.generate.new.template import (
    PARTS,
    TEMPLATES,
    parts_of,
    shipped_formats,
    template_text,
    write_template,
)

__all__ = ["PARTS", "TEMPLATES", "parts_of", "shipped_formats", "template_text", "write_template"]
