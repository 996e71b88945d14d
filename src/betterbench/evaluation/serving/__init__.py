"""Serving of policies with openpi's protocol: the server, its sessions, the policy host, and shadow simulations."""
