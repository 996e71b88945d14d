"""Server side of the openpi protocol: connections, their callers, and a budget for frame sizes."""
