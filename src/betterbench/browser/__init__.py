"""Browser pages served on this machine, protected by a token in their address.

- ``server``: viser's server, its elements and its end; ``plain``: a server of files and JSON, without viser.
- ``address``: the address that a page is opened at.
- ``gate``, ``incoming``: access control, and a filter for incoming messages.
- ``keys``: pressed keys and gamepads, as the script of the page (``page.js``) sends them.
"""
