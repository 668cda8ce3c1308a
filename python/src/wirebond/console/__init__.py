"""The console: a web server for the page, and for programs that want what it has. See docs/console.md."""

from wirebond.console.connector import Options
from wirebond.console.console import DEFAULT_PORT, Console

__all__ = ["DEFAULT_PORT", "Console", "Options"]
