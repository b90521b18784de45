# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender out: own scenes, the compositor and materials."""
