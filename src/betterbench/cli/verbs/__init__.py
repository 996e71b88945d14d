"""The verbs of the command line, one file each; ``betterbench.cli.main`` imports the one that is given."""
