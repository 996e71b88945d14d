"""Policies served with the openpi protocol: server, sessions, host of a run, and shadow simulations of experts."""
