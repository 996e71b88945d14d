"""Kinds of policies: the list of addresses, the factory, and the kinds that need no other package."""
