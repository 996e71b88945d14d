"""The subcommands of the command line, one file each. ``betterbench.cli.main`` imports only the chosen subcommand."""
