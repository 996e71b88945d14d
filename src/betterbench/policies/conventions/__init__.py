"""Policy conventions: translation of observations and actions, and the handshake with a policy server.

``presets`` lists the conventions of known checkpoints. ``adapter`` applies the conventions to observations and actions.
"""
