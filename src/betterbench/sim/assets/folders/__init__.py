"""Folders of imported assets, with a readable manifest and one file per asset.

``better assets import`` writes such a folder, and ``--asset-dir`` registers its assets. A folder may come from an
untrusted source, so none of its content is executed, and all files are checked when they are read.

- ``manifest``: the list of the assets with source, license, options, size and mass.
- ``registration``: the assets as categories that tasks can name.
- ``job``: the import of many files into a folder.
"""

from betterbench.sim.assets.folders.registration import asset_folder

__all__ = ["asset_folder"]
