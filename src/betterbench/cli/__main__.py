"""Run the command line with ``python -m betterbench.cli``."""

from betterbench.cli import main

if __name__ == "__main__":
    main()
