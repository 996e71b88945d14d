"""Small servers that users copy to their GPU machine. Each is a single file that does not depend on this package."""
