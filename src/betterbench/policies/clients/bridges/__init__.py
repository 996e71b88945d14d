"""Small servers (bridges) that users copy to their GPU machine.

Each is a single file that does not need this package.
"""
