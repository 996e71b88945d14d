"""Local web servers for pages that betterbench shows in a browser, such as the teleoperation page.

A secret token in the address of a page protects it from other users of the machine.

- ``server``: server based on the library viser. ``plain``: server for files and JSON without additional libraries.
- ``address``: address of a page.
- ``gate``: access control. ``incoming``: validation of the messages that a page sends.
- ``keys``: keyboard and gamepad input, which the script ``page.js`` sends.
"""
