"""Images of scenes, and videos that are rendered from the records of trials."""
