# SPDX-License-Identifier: Apache-2.0
"""Acceleration structures for ray tracing, built on the CPU.

    import bvhd
    with bvhd.Client() as client:
        ground = client.build(bvhd.Triangles(vertices, indices))
        scene = client.build(bvhd.TopLevel([ground]))
    open("ground.as", "wb").write(ground.data)

It needs the library libbvhd, which exists for Linux only.
"""
from . import cpu
from ._enums import (
    Builder,
    BuildFlags,
    CacheAction,
    EndCaps,
    GeometryFlags,
    HitFlags,
    IndexingMode,
    InstanceFlags,
    LayoutFlags,
    Local,
    Origin,
    Priority,
    Quality,
    RayFlags,
    Status,
    Target,
    VertexFormat,
)
from ._errors import Error
from ._library import lib as _lib
from .client import Batch, Client, Format, Result
from .container import Container
from .geometry import Aabbs, BottomLevel, Reference, Spheres, SweptSpheres, TopLevel, Triangles

#: The version of the library.
__version__: str = _lib.bvhd_version().decode()

__all__ = [
    "Aabbs",
    "Batch",
    "BottomLevel",
    "BuildFlags",
    "Builder",
    "CacheAction",
    "Client",
    "Container",
    "EndCaps",
    "Error",
    "Format",
    "GeometryFlags",
    "HitFlags",
    "IndexingMode",
    "InstanceFlags",
    "LayoutFlags",
    "Local",
    "Origin",
    "Priority",
    "Quality",
    "RayFlags",
    "Reference",
    "Result",
    "Spheres",
    "Status",
    "SweptSpheres",
    "Target",
    "TopLevel",
    "Triangles",
    "VertexFormat",
    "cpu",
]
