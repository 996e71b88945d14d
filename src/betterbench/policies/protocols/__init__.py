"""Message encodings (msgpack, JSON, torch) and websocket connections for the protocols of policy servers."""
