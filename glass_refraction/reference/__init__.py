# SPDX-License-Identifier: GPL-3.0-or-later
"""The same frame with real glass in Cycles, and how far apart two pictures are.

Pictures are arrays (H, W, channels) with the bottom row first, as Blender stores pixels.
"""
