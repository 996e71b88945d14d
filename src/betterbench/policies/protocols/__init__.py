"""Codecs and sockets of policy protocols, for msgpack, JSON, torch tensors and websockets."""
