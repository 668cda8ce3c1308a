"""The protocol's own document, in Markdown, for people who write the other end without Wirebond."""

from wirebond.generate.doc.chinese import chinese_document
from wirebond.generate.doc.pages import markdown

__all__ = ["chinese_document", "markdown"]
