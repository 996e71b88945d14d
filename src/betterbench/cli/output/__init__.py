"""Tables and texts printed by subcommands, imported when needed."""
