# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked frames: written, and shown without the extension."""
