"""Subcommands of the command line, one file each. ``betterbench.cli.main`` imports only the subcommand that is run."""
