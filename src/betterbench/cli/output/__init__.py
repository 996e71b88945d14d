"""What verbs print; imported by a verb when it has something to print."""
