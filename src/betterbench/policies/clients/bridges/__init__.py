"""Bridges: policy servers that consist of a single file, which users copy to their GPU machine.

The files do not import betterbench.
"""
