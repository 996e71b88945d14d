"""Small servers to copy to the machine with the GPU; each is one file that needs nothing of this package."""
