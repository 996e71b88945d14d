"""Printed marker sheet for the real scene, and measurement of the front camera's pose from the markers.

- ``layout``: positions of the markers, the slots and the arm's base on the sheet, and the printed tiles.
- ``drawing``: shapes in millimeters, written as SVG and PDF at true scale.
- ``pages``: the pages of the sheet for a paper size.
- ``camera_pose``: detection of the markers, the pose of the camera, and the motion that brings it to the pose of the
  simulated camera.
"""
