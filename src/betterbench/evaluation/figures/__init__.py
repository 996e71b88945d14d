"""Images of scenes and films of records."""
