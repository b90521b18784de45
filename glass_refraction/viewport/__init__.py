# SPDX-License-Identifier: GPL-3.0-or-later
"""The live picture in 3D views: what is seen through the glasses, drawn on the GPU.

``eye`` turns a view into a viewpoint, ``picture`` finds what is to be drawn (arrays only),
``paint`` draws it (the only place that touches ``gpu``, and only while a view is drawn), ``views``
knows which views ask for it and when.
"""
