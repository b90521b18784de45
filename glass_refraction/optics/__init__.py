# SPDX-License-Identifier: GPL-3.0-or-later
"""What light does at glass: where points appear, what each pixel sees. Pure NumPy, metres."""

from .apparent import apparent_points
from .axial import RayEnds, Stop, follow_rays, reach
from .bodies import body
from .chains import (
    ChainedPath,
    Pair,
    chained_points,
    first_met,
    has_chained_images,
    trace_chain,
)
from .dispersion import LINES, dispersed_ior
from .exit_rays import ExitRays, exit_rays
from .glasses import CylinderGlass, FlatGlass, SphereGlass
from .images import ApparentPoints
from .interpolation import edge_gaps, edges_to_split, triangle_gaps
from .laws import fresnel, reflect, refract
from .lengths import path_lengths
from .media import MEDIA
from .paths import LightPath, ParallelView
from .placed import Placed, PlacedGlass, PlacedMesh
from .revolution import RevolutionGlass
from .tracing import TracedRays, trace
from .tumbler import Tumbler
from .weights import light_paths, path_weights

__all__ = [
    "LINES",
    "MEDIA",
    "ApparentPoints",
    "ChainedPath",
    "CylinderGlass",
    "ExitRays",
    "FlatGlass",
    "LightPath",
    "Pair",
    "ParallelView",
    "Placed",
    "PlacedGlass",
    "PlacedMesh",
    "RayEnds",
    "RevolutionGlass",
    "SphereGlass",
    "Stop",
    "TracedRays",
    "Tumbler",
    "apparent_points",
    "body",
    "chained_points",
    "dispersed_ior",
    "edge_gaps",
    "edges_to_split",
    "exit_rays",
    "first_met",
    "follow_rays",
    "fresnel",
    "has_chained_images",
    "light_paths",
    "path_lengths",
    "path_weights",
    "reach",
    "reflect",
    "refract",
    "trace",
    "trace_chain",
    "triangle_gaps",
]
