"""Functions that print the tables and messages of subcommands. They are imported only when needed."""
