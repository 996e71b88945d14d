"""Serving of policies with openpi's protocol: server, sessions, policy host, and shadow simulations for experts."""
