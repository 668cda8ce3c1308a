"""One owner, many clients: a server owns a link, and programs attach to it. ``wirebond serve`` runs one."""

from wirebond.server.server import Server

__all__ = ["Server"]
