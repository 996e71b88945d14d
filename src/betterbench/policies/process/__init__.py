"""User policies in a separate process."""
