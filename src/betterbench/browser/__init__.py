"""Pages that betterbench shows in a web browser.

The pages are served on this machine, and a token in their address protects them from other users.

- ``server``: server that uses the library viser. ``plain``: server for files and JSON, which needs no library.
- ``address``: address under which a page is opened.
- ``gate``: access control. ``incoming``: filter for the messages that a page sends.
- ``keys``: pressed keys and gamepad states, which the script of the page (``page.js``) sends.
"""
