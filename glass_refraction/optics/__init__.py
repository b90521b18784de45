"""What light does at glass: where points appear, what each pixel sees. Pure NumPy, metres."""

from .apparent import apparent_points
from .glasses import CylinderGlass, FlatGlass, SphereGlass
from .images import ApparentPoints
from .laws import fresnel, reflect, refract
from .media import MEDIA
from .paths import LightPath, ParallelView
from .tracing import TracedRays, trace

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
    "reflect",
    "refract",
    "trace",
]
