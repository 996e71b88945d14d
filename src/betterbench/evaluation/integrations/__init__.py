"""Our tasks inside other evaluation harnesses."""
