"""Policies served with the openpi protocol: server, sessions, a run's policy host, and shadow simulations for experts."""
