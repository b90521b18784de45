# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's method: displaced copies, moved vertex by vertex, and the regions of light paths."""
