"""Message encodings and sockets for policy protocols: msgpack, JSON, torch tensors and websockets."""
