"""Browser pages served by viser on this machine, protected by a token in their address.

- ``server``: the server, its address, its elements and its end.
- ``gate``, ``incoming``: access control, and a filter for incoming messages.
- ``keys``: pressed keys and gamepads, as the script of the page (``page.js``) sends them.
"""
