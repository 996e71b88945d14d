"""Folders of imported assets. A folder has a readable manifest and one file per asset.

``better assets import`` writes such a folder, and ``--asset-dir`` registers the assets in it. A folder may come from an
untrusted source. Therefore nothing in it is executed, and all files are checked when they are read.

- ``manifest``: the list of the assets, with source, license, import options, size and mass.
- ``registration``: registers the assets as categories that tasks can name.
- ``job``: imports many files into a folder.
"""

from betterbench.sim.assets.folders.registration import asset_folder

__all__ = ["asset_folder"]
