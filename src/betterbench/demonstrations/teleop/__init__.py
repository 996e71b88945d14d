"""Teleoperation: a person demonstrates in the browser, and the record has the same form as any demonstration."""
