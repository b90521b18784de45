# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of lamps that glasses turn aside: their shadows, and what they gather."""
