"""Server side of the openpi protocol: connections, access control, and a memory budget for frames."""
