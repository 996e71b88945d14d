"""Serving of policies with the openpi protocol: server, sessions, policy host, and shadow simulations for experts."""
