"""Codecs and sockets of policy protocols: msgpack, JSON, tensors of torch, and websockets."""
