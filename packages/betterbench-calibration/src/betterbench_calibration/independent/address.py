"""How the addresses of the independent family begin."""

PREFIX = "independent:"
