"""Input and output conventions of policies: conversion of observations and actions, and the handshake with servers.

``presets`` defines the conventions of known checkpoints, and ``adapter`` converts observations and actions accordingly.
"""
