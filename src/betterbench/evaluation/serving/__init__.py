"""Policies served with the openpi protocol: server, sessions, the host of a run, shadow simulations of experts."""
