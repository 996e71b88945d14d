"""Functions that print the tables and messages of subcommands, and are imported only when needed."""
