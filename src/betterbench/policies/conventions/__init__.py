"""Policy conventions: translation of observations and actions, and the handshake that compares both sides.

``presets`` names the conventions of known checkpoints; ``adapter`` applies them.
"""
