"""User policies, loaded from a Python file, in a separate process."""
