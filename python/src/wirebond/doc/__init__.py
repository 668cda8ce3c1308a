"""The protocol's own document, in Markdown, for people who write the other end without Wirebond."""

from wirebond.doc.pages import markdown

__all__ = ["markdown"]
