"""A first protocol file: from a template, or from a C header."""

from wirebond.generate.new.template import TEMPLATES, write_template

__all__ = ["TEMPLATES", "write_template"]
