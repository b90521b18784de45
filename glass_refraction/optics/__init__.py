# SPDX-License-Identifier: GPL-3.0-or-later
"""What light does at glass: where points appear, what each pixel sees. Pure NumPy, metres."""

from .apparent import apparent_points
from .bodies import body
from .dispersion import LINES, dispersed_ior
from .exit_rays import ExitRays, exit_rays
from .glasses import CylinderGlass, FlatGlass, SphereGlass
from .images import ApparentPoints
from .laws import fresnel, reflect, refract
from .lengths import path_lengths
from .media import MEDIA
from .paths import LightPath, ParallelView
from .placed import Media, Placed, PlacedGlass, PlacedMesh
from .revolution import RevolutionGlass
from .tracing import TracedRays, stretches, trace
from .tumbler import Tumbler
from .weights import light_paths, path_weights

__all__ = [
    "LINES",
    "MEDIA",
    "ApparentPoints",
    "CylinderGlass",
    "ExitRays",
    "FlatGlass",
    "LightPath",
    "Media",
    "ParallelView",
    "Placed",
    "PlacedGlass",
    "PlacedMesh",
    "RevolutionGlass",
    "SphereGlass",
    "TracedRays",
    "Tumbler",
    "apparent_points",
    "body",
    "dispersed_ior",
    "exit_rays",
    "fresnel",
    "light_paths",
    "path_lengths",
    "path_weights",
    "reflect",
    "refract",
    "stretches",
    "trace",
]
