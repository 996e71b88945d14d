"""Server side of the openpi protocol, with connections, access control and a memory budget for frames."""
