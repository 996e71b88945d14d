"""Demonstrations: given by the expert in a human manner, amplified to new starts, and told apart from trials."""
