"""Small servers to copy to the machine with the GPU. Each is one file that does not depend on this package."""
