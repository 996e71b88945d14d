"""Printed marker sheet for the real scene, and measurement of the front camera's pose from the markers.

- ``layout``: positions on the sheet: markers, slots, the arm's base, and the tiles that are printed.
- ``drawing``: shapes in millimeters, written as SVG and PDF at true scale.
- ``pages``: the pages of the sheet for a paper size.
- ``camera_pose``: detection of the markers, the pose of the camera, and the motion that brings it to the pose of the
  simulated camera.
"""
