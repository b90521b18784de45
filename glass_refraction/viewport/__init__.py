# SPDX-License-Identifier: GPL-3.0-or-later
"""The live picture in 3D views: what is seen through the glasses, drawn on the GPU.

``eye`` turns a view into a viewpoint, ``places`` finds where glasses stand, ``model`` reads them
and ``description`` writes them down for the shader (``glsl``). ``capture`` draws the surroundings,
``paint`` the picture; ``views`` knows which views ask for it and when.
"""
