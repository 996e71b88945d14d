"""Worker processes and the environments that each of them keeps open."""
