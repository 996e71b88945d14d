"""Small servers to copy to the machine with the GPU; each is one file without dependencies on this package."""
