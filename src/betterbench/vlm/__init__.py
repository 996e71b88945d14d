"""Static evaluation of vision-language models.

- ``models``: resolutions of pictures, and models in the process.
"""
