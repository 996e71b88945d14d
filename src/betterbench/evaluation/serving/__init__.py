"""Policies of this package behind a network protocol, and hosts that hold one policy for many workers."""
