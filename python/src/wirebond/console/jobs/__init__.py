"""Does long work in another process, so that the thread that moves a line's bytes does not wait for it."""

from wirebond.console.jobs.worker import JobError, Worker, as_json

__all__ = ["JobError", "Worker", "as_json"]
