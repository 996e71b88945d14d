"""Tables and texts printed by verbs; a verb imports them when needed."""
