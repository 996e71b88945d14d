"""Small servers to copy to the GPU machine. Each is a single file without dependencies on this package."""
