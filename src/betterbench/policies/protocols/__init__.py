"""Message encodings and sockets of policy protocols: msgpack, JSON, torch tensors and websockets."""
