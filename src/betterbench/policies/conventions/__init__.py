"""Conversion between policies and betterbench: translation of observations and actions, and the server handshake.

``presets`` lists the conventions of known checkpoints. ``adapter`` applies the conventions to observations and actions.
"""
