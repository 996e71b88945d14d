"""Policy server for openpi's protocol, with access control and limits on clients and memory."""
