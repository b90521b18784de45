"""What light does at glass: where points appear, what each pixel sees. Pure NumPy, metres."""

from .apparent import apparent_points
from .glasses import CylinderGlass, FlatGlass, SphereGlass
from .images import ApparentPoints
from .laws import fresnel, reflect, refract
from .media import MEDIA
from .paths import LightPath, ParallelView
from .tracing import TracedRays, trace
from .weights import light_paths, path_weights

__all__ = [
    "MEDIA",
    "ApparentPoints",
    "CylinderGlass",
    "FlatGlass",
    "LightPath",
    "ParallelView",
    "SphereGlass",
    "TracedRays",
    "apparent_points",
    "fresnel",
    "light_paths",
    "path_weights",
    "reflect",
    "refract",
    "trace",
]
