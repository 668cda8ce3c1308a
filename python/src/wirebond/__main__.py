"""``python -m wirebond``: the same as the ``wirebond`` command."""

from wirebond.cli.start import main

if __name__ == "__main__":
    main()
