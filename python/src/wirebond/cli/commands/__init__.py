"""One module per command. A module named after a command does its work; `*_view` prints its result."""
