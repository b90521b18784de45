# SPDX-License-Identifier: GPL-3.0-or-later
"""The one way to the picture: exit rays, their hits, and the radiance views that show these."""
