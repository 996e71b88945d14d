"""The printed marker sheet of the real scene, and the pose of the front camera that is measured with it.

- ``layout``: positions on the sheet: markers, slots, the arm's base, and the tiles that are printed.
- ``drawing``: shapes in millimeters, written as SVG and PDF at true scale.
- ``pages``: the pages of the sheet for a size of paper.
- ``camera_pose``: the markers in an image, the camera's pose, and how to move it to that of the twin.
"""
