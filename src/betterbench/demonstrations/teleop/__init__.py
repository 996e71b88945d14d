"""Teleoperation: a person demonstrates in the browser, and the record is the same as that of any demonstration."""
