# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender in: glasses, sources, meshes and the camera, read into NumPy."""
