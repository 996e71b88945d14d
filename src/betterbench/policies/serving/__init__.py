"""Server of openpi's protocol: connections, access control, and a limit on the memory that messages take."""
