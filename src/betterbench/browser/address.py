"""Web address of a page."""


def origin_of(host: str, port: int) -> str:
    """Return the origin of a page, for example ``http://localhost:8080``. IPv6 addresses are enclosed in brackets."""
    name = "localhost" if host == "127.0.0.1" else f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}"
