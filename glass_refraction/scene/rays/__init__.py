# SPDX-License-Identifier: GPL-3.0-or-later
"""True shading: exit rays, their hits and the views that show those."""
