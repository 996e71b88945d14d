"""Policy conventions: translation of observations and actions, and the handshake with a server.

``presets`` lists the conventions of known checkpoints, and ``adapter`` applies them.
"""
