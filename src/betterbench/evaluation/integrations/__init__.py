"""The tasks as benchmarks of other evaluation harnesses."""
