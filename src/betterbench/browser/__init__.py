"""Pages that betterbench shows in a web browser.

They are served on this machine and protected by a token in the address.

- ``server``: server that uses viser. ``plain``: server for files and JSON, without viser.
- ``address``: address under which a page is opened.
- ``gate``: access control. ``incoming``: filter for messages from the page.
- ``keys``: pressed keys and gamepad states, which the script of the page (``page.js``) sends.
"""
