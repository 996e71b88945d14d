"""Server for openpi's protocol, with access control and a limit on the memory that messages take."""
