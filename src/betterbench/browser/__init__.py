"""Browser pages served on this machine, protected by a token in their address.

- ``server``: the viser server; ``plain``: a server for files and JSON, without viser.
- ``address``: the address at which a page is opened.
- ``gate``: access control; ``incoming``: a filter for the messages from the page.
- ``keys``: pressed keys and gamepad states, sent by the page's script (``page.js``).
"""
