"""Conventions of policies: how observations and actions are translated, and the handshake that compares both sides.

``presets`` names the conventions of known checkpoints; ``adapter`` applies them.
"""
