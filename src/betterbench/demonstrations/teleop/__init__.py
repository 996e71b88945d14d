"""Teleoperation: human demonstrations in the browser, recorded in the same format as all other demonstrations."""
