"""Images of scenes and videos of records."""
